# Build and run: docker build -t infonerf . && docker run --rm -v "$PWD/runs:/home/infonerf/runs" infonerf demo
FROM rust:1.95-bookworm AS build
WORKDIR /src
COPY . .
RUN cargo build --locked --release && strip target/release/infonerf

FROM debian:bookworm-slim
RUN useradd --create-home infonerf
COPY --from=build /src/target/release/infonerf /usr/local/bin/infonerf
USER infonerf
WORKDIR /home/infonerf
ENTRYPOINT ["infonerf"]
CMD ["--help"]
