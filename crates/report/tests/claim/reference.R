# Reference values of the intervals of paired differences, made with R, lme4 and lmerTest.
#
#     apt-get install r-base-core r-cran-lme4 r-cran-lmertest r-cran-jsonlite
#     Rscript reference.R > reference.json
#
# A case holds the differences of each scene, one per view set. `these` is the interval of the mean over exactly these
# scenes, `alike` that of the mean over scenes like them.

suppressMessages(library(lmerTest))

cases <- list(
  balanced = list(c(0.9, 1.4, 0.2), c(2.1, 2.9, 2.5), c(-0.3, 0.8, 0.1), c(1.5, 1.1, 2.2)),
  unbalanced = list(c(0.9, 1.4), c(2.1, 2.9, 2.5, 3.3, 2.0), c(-0.3), c(1.5, 1.1, 2.2)),
  scenes_alike = list(c(0.9, 1.7, -0.2), c(1.2, 0.1, 1.3), c(0.4, 1.5, 0.6)),
  unbalanced_alike = list(c(0.9, 1.7, -0.2, 0.7), c(1.2, 0.1), c(0.4, 1.5, 0.6)),
  scenes_apart = list(c(0.9, 0.91), c(2.1, 2.13, 2.12), c(-3.5, -3.48), c(1.5, 1.51, 1.52, 1.49)),
  one_scene = list(c(0.9, 1.4, 0.2, 0.7, 1.1)),
  one_view_set = list(0.9, 2.1, -0.3, 1.5)
)

interval <- function(mean, se, df) {
  half <- qt(0.975, df) * se
  list(mean = mean, low = mean - half, high = mean + half)
}

of <- function(t) list(mean = unname(t$estimate), low = t$conf.int[1], high = t$conf.int[2])

# Paired differences, so that Student's one-sample test is his paired one.
these <- function(data) {
  if (nlevels(data$scene) == 1) return(of(t.test(data$d)))
  if (nlevels(data$scene) == nrow(data)) return(NULL)
  # With contrasts that sum to zero the intercept is the mean of the scenes' means.
  fit <- lm(d ~ scene, data, contrasts = list(scene = "contr.sum"))
  row <- coef(summary(fit))["(Intercept)", ]
  interval(row["Estimate"], row["Std. Error"], fit$df.residual)
}

alike <- function(data) {
  if (nlevels(data$scene) == 1) return(NULL)
  if (nlevels(data$scene) == nrow(data)) return(of(t.test(data$d)))
  control <- lmerControl(optimizer = "bobyqa", optCtrl = list(rhoend = 1e-12), check.conv.singular = "ignore")
  fit <- lmer(d ~ 1 + (1 | scene), data, REML = TRUE, control = control)
  row <- coef(summary(fit, ddf = "Satterthwaite"))["(Intercept)", ]
  interval(row["Estimate"], row["Std. Error"], row["df"])
}

result <- lapply(names(cases), function(name) {
  scenes <- cases[[name]]
  data <- data.frame(
    d = unlist(scenes),
    scene = factor(rep(seq_along(scenes), lengths(scenes)))
  )
  list(case = name, scenes = lapply(scenes, I), these = these(data), alike = alike(data))
})
cat(jsonlite::toJSON(result, auto_unbox = TRUE, null = "null", digits = 10, pretty = TRUE), "\n")
