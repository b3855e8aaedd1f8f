const MODES = ['colour', 'depth', 'normals'];
const FILL = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
const SHOW = `#version 300 es
precision highp float;
uniform sampler2D coarse, fine;
uniform vec2 size;
uniform float done;
out vec4 color;
void main() {
  vec2 at = gl_FragCoord.xy / size;
  color = at.y < done ? texture(fine, at) : texture(coarse, at);
}`;

/** Reason, in `message`, why a browser cannot draw the field. */
class CannotDraw extends Error {}

/** Inflates bytes that were deflated into base64 text. */
async function inflate(text) {
  if (!self.DecompressionStream) throw new CannotDraw('This browser cannot unpack the scene: it has no DecompressionStream.');
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Computes for each cell of a grid the distance to the nearest occupied one in steps to any of the 26 neighbours, 255 at most:
 * two sweeps over a grid with a border, which counts as occupied unless nothing lies beyond it.
 */
function emptyDistances(bits, [nx, ny, nz], closed) {
  const wx = nx + 2, wy = ny + 2, distance = new Uint8Array(wx * wy * (nz + 2)).fill(closed ? 255 : 0);
  const place = (x, y, z) => x + 1 + wx * (y + 1 + wy * (z + 1));
  for (let z = 0, cell = 0; z < nz; z++)
    for (let y = 0; y < ny; y++)
      for (let x = 0; x < nx; x++, cell++) distance[place(x, y, z)] = (bits[cell >> 3] >> (cell & 7)) & 1 ? 0 : 255;
  const before = [];
  for (const dz of [-1, 0, 1]) for (const dy of [-1, 0, 1]) for (const dx of [-1, 0, 1]) {
    const step = dx + wx * (dy + wy * dz);
    if (step < 0) before.push(step);
  }
  const sweep = (sign) => {
    for (let z = 0; z < nz; z++)
      for (let y = 0; y < ny; y++)
        for (let x = 0; x < nx; x++) {
          const at = sign > 0 ? place(x, y, z) : place(nx - 1 - x, ny - 1 - y, nz - 1 - z);
          let least = distance[at];
          for (let k = 0; k < 13 && least > 0; k++) least = Math.min(least, distance[at + sign * before[k]] + 1);
          distance[at] = least;
        }
  };
  sweep(1);
  sweep(-1);
  const inner = new Uint8Array(nx * ny * nz);
  for (let z = 0; z < nz; z++)
    for (let y = 0; y < ny; y++) inner.set(distance.subarray(place(0, y, z), place(nx, y, z)), nx * (y + ny * z));
  return inner;
}

/** Draws one scene on a canvas: coarse while the camera moves, then at full resolution, some rows at a time. */
class Viewer {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = canvas.getContext('webgl2', { alpha: false, antialias: true, powerPreference: 'high-performance' });
    if (!gl) throw new CannotDraw('This browser has no WebGL2, which drawing the scene needs.');
    this.gl = gl;
    this.mode = 0;
    this.scale = 0.35;
    this.rowsPerMs = 4;
    this.movingUntil = 0;
    this.rows = 0;
    this.coarse = this.target();
    this.fine = this.target();
    this.show = this.program(FILL, SHOW);
    this.overlay = new Overlay(this);
    this.textures = [];
    this.buffers = [];
    new ResizeObserver(() => this.changed()).observe(canvas);
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => location.reload());
  }

  program(vertex, fragment) {
    const { gl } = this, program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      program.log = () => gl.getShaderInfoLog(shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS))
      throw new CannotDraw(`This graphics driver refused the scene's shader: ${gl.getProgramInfoLog(program) || program.log()}`);
    program.at = (name) => gl.getUniformLocation(program, name);
    return program;
  }

  /** Makes a target of colour and depth. */
  target() {
    const { gl } = this, target = { width: 0, height: 0, frame: gl.createFramebuffer() };
    target.textures = [0, 1].map((i) => {
      const texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      this.filter(gl.TEXTURE_2D, i === 0 ? gl.LINEAR : gl.NEAREST);
      return texture;
    });
    // Returns whether the size changed, and the image is gone.
    target.resize = (width, height) => {
      if (target.width === width && target.height === height) return false;
      Object.assign(target, { width, height });
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
      target.textures.forEach((texture, i) => {
        gl.bindTexture(gl.TEXTURE_2D, texture);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, texture, 0);
      });
      gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
      return true;
    };
    return target;
  }

  filter(kind, filter) {
    const { gl } = this;
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(kind, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(kind, name, gl.CLAMP_TO_EDGE);
  }

  /**
   * Shows another scene, or the same one trained further; with `keepCamera` the camera stays. Returns false and shows nothing if
   * another scene is to be loaded before this one is unpacked.
   */
  async load(scene, keepCamera) {
    this.wanted = scene;
    const { gl } = this, [bytes, images] = await Promise.all([inflate(scene.data), decodedImages(scene)]);
    if (this.wanted !== scene) return false;
    const part = (name) => bytes.slice(scene.parts[name][0], scene.parts[name][0] + scene.parts[name][1]);
    const field = this.shader === scene.shader ? this.field : this.program(FILL, scene.shader);
    if (field !== this.field && this.field) gl.deleteProgram(this.field);
    [this.field, this.shader] = [field, scene.shader];
    gl.useProgram(field);
    for (const texture of this.textures) gl.deleteTexture(texture);
    for (const buffer of this.buffers) gl.deleteBuffer(buffer);
    [this.textures, this.buffers] = [[], []];
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const texture = (name, kind, filter, upload) => {
      gl.activeTexture(gl.TEXTURE0 + this.textures.length);
      const made = gl.createTexture();
      gl.bindTexture(kind, made);
      upload();
      this.filter(kind, filter);
      gl.uniform1i(field.at(name), this.textures.length);
      made.kind = kind;
      this.textures.push(made);
    };
    texture('grid', gl.TEXTURE_3D, gl.NEAREST, () =>
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8UI, ...scene.grid, 0, gl.RED_INTEGER, gl.UNSIGNED_BYTE,
        emptyDistances(part('occupied'), scene.grid, scene.closed)));
    (scene.atlas ? loadBricks : loadTables)(this, scene, part, texture);
    const state = keepCamera && this.camera ? this.camera.state() : null;
    this.scene = scene;
    this.camera = new Camera(scene);
    if (state) this.camera.restore(state);
    else this.camera.take(scene.cameras[0]);
    this.overlay.load(scene, images);
    this.changed();
    return true;
  }

  /** Draws the scene anew, coarsely until nothing has changed for 150 ms: called where the camera, the mode or the scene changed. */
  changed() {
    this.dirty = true;
    this.movingUntil = performance.now() + 150;
    this.wake();
  }

  /** Stops drawing frames. */
  stop() {
    this.stopped = true;
  }

  wake() {
    if (this.waiting || this.stopped || !this.scene) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      if (!this.stopped) this.frame(now);
    });
  }

  /** Draws one frame, once the graphics card has finished the last one. */
  frame(now) {
    const { gl, canvas } = this;
    if (this.fence) {
      const state = gl.clientWaitSync(this.fence.sync, 0, 0);
      if (state === gl.TIMEOUT_EXPIRED) return this.wake();
      gl.deleteSync(this.fence.sync);
      this.fence.finished(Math.max(1, performance.now() - this.fence.started));
      this.fence = null;
    }
    const ratio = Math.min(window.devicePixelRatio, 2);
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    if (this.dirty) {
      this.coarse.resize(Math.max(8, Math.round(width * this.scale)), Math.max(8, Math.round(height * this.scale)));
      this.render(this.coarse, 0, this.coarse.height);
      this.after((ms) => {
        // About 30 frames a second.
        this.scale = Math.max(0.08, Math.min(1, this.scale * Math.sqrt(Math.max(0.5, Math.min(1.3, 30 / ms)))));
      });
      [this.dirty, this.rows] = [false, 0];
    } else if (now >= this.movingUntil) {
      if (this.fine.resize(width, height)) this.rows = 0;
      if (this.rows < height) {
        const rows = Math.max(4, Math.min(height - this.rows, Math.round(40 * this.rowsPerMs)));
        this.render(this.fine, this.rows, rows);
        this.after((ms) => (this.rowsPerMs = 0.5 * this.rowsPerMs + (0.5 * rows) / ms));
        this.rows = Math.min(height, this.rows + rows);
      }
    }
    this.present(this.rows / height);
    if (this.fence || this.rows < height) this.wake();
  }

  after(finished) {
    const { gl } = this;
    this.fence = { sync: gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0), started: performance.now(), finished };
    gl.flush();
  }

  /** Draws the field into some rows of a target. */
  render(target, first, rows) {
    const { gl, field, scene, camera } = this, { width, height } = target;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, first, width, rows);
    gl.useProgram(field);
    this.textures.forEach((texture, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(texture.kind, texture);
    });
    const interval = camera.interval();
    this.reach = 2 * interval[1];
    this.setCamera(field, width, height);
    gl.uniform1f(field.at('height'), height);
    gl.uniform2fv(field.at('interval'), interval);
    gl.uniform3fv(field.at('background'), scene.background);
    gl.uniform1i(field.at('mode'), this.mode);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Hands the camera to the program in use, for an image of this size, and the distance that a depth of 1 stands for. */
  setCamera(program, width, height) {
    const { gl, camera } = this;
    gl.uniform3fv(program.at('eye'), camera.eye);
    gl.uniformMatrix3fv(program.at('axes'), false, [...camera.right, ...camera.up, ...camera.back]);
    gl.uniform4fv(program.at('lens'), camera.lensOn(width, height));
    gl.uniform1f(program.at('reach'), this.reach);
  }

  /** Shows the share `done` of the fine image from below, and the coarse one above. */
  present(done) {
    const { gl, canvas, show } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.useProgram(show);
    [this.coarse, this.fine].forEach((target, i) => {
      gl.activeTexture(gl.TEXTURE0 + i);
      gl.bindTexture(gl.TEXTURE_2D, target.textures[0]);
      gl.uniform1i(show.at(['coarse', 'fine'][i]), i);
    });
    gl.uniform2f(show.at('size'), canvas.width, canvas.height);
    gl.uniform1f(show.at('done'), done);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.overlay.draw(done === 1 ? this.fine : this.coarse);
  }

  /** Draws the field alone in `width` × `height` pixels: bytes of RGBA, top row first. */
  pixels(width, height) {
    const { gl } = this, target = this.target(), bytes = new Uint8Array(4 * width * height);
    target.resize(width, height);
    this.render(target, 0, height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    const flipped = new Uint8Array(bytes.length), row = 4 * width;
    for (let y = 0; y < height; y++) flipped.set(bytes.subarray(row * y, row * (y + 1)), row * (height - 1 - y));
    return flipped;
  }
}
