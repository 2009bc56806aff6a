/* The bank's kernel in C, for scripts/bench replay: same state layout, same operations.
   Written by hand from the equations; columns as in teleop_rt/estimation/layout.py. */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { RLS, SPRLS, NI_SPRLS, GN_VFF_RLS, IEC };
enum { SOLVER, FORGETTING, PRIOR, CEILING, BETA, GAMMA, NOISE_VARIANCE, RHO, ALPHA, LAMBDA_MIN,
       LAMBDA_MAX, DELTA_START, BLOCK, WARM_UP, ONE_SIDED, N_SETTINGS };
enum { LAMBDA, DELTA, MEAN_SQUARE, COUNT, RESTARTS, STATUS, ERROR, READY, BLOCK_COUNT, BLOCKS,
       REJECTED, GRADIENT_RESTARTS, SINCE_RESTART };
enum { MOST = 8, THETA = 16, PSI = 24, GAIN = 32, SCRATCH = 40, SCORE = 48, INFO = 56,
       SCORE_POWER = 64, INFO_POWER = 72, EXCITATION = 80, SENSITIVITY = 88, COVARIANCE = 96,
       GRADIENT = 160, PROPAGATED = 224, ROW_SIZE = 288 };

static void forget(double *S, const double *W, int n) {
  double restarts = S[RESTARTS], rejected = S[REJECTED], gradients = S[GRADIENT_RESTARTS];
  double since = S[SINCE_RESTART];
  memset(S, 0, sizeof(double) * ROW_SIZE);
  S[RESTARTS] = restarts, S[REJECTED] = rejected, S[GRADIENT_RESTARTS] = gradients;
  S[SINCE_RESTART] = since;
  int solver = (int)W[SOLVER];
  S[LAMBDA] = solver == GN_VFF_RLS ? W[LAMBDA_MAX] : W[FORGETTING];
  S[DELTA] = W[DELTA_START];
  if (solver != IEC)
    for (int i = 0; i < n; i++) S[COVARIANCE + i * MOST + i] = S[PROPAGATED + i * MOST + i] = W[PRIOR];
}

static int covariance_step(double *S, const double *phi, double lambda, double ceiling, int n) {
  double spread = lambda, trace = 0;
  int healthy = 1;
  for (int i = 0; i < n; i++) spread += phi[i] * S[SCRATCH + i];
  for (int i = 0; i < n; i++) {
    double gain = S[SCRATCH + i] / spread;
    S[GAIN + i] = gain;
    for (int j = 0; j <= i; j++) {
      double value = S[COVARIANCE + i * MOST + j] - gain * S[SCRATCH + j];
      S[COVARIANCE + i * MOST + j] = S[COVARIANCE + j * MOST + i] = value;
    }
    trace += S[COVARIANCE + i * MOST + i];
    healthy = healthy && S[COVARIANCE + i * MOST + i] > 0;
  }
  if (lambda < 1 && trace < ceiling * lambda)
    for (int i = 0; i < n; i++)
      for (int j = 0; j < n; j++) S[COVARIANCE + i * MOST + j] /= lambda;
  return healthy && isfinite(trace);
}

static void perturb(double *S, double amount, double ceiling, int n) {
  if (!(amount > 0)) return;
  double trace = 0;
  for (int i = 0; i < n; i++) trace += S[COVARIANCE + i * MOST + i];
  double added = fmin(amount, (ceiling - trace) / n);
  if (added > 0)
    for (int i = 0; i < n; i++) S[COVARIANCE + i * MOST + i] += added;
}

static void propagate(double *S, const double *phi, int n) {
  double spread = 1;
  for (int i = 0; i < n; i++) {
    double total = 0;
    for (int j = 0; j < n; j++) total += S[PROPAGATED + i * MOST + j] * phi[j];
    S[SCRATCH + i] = total;
    spread += phi[i] * total;
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j <= i; j++) {
      double value = S[PROPAGATED + i * MOST + j] - S[GAIN + i] * S[SCRATCH + j];
      value += (spread * S[GAIN + i] - S[SCRATCH + i]) * S[GAIN + j];
      S[PROPAGATED + i * MOST + j] = S[PROPAGATED + j * MOST + i] = value;
    }
}

static double forgetting_step(double *S, const double *W, const double *phi, double e, int n) {
  double g = 0, alpha = W[ALPHA];
  for (int i = 0; i < n; i++) g += S[PSI + i] * phi[i];
  S[DELTA] = fmax((1 - alpha) * S[DELTA] + alpha * g * g, 1e-12);
  double lambda = S[LAMBDA] + alpha * g * e / S[DELTA];
  return S[LAMBDA] = fmin(fmax(lambda, W[LAMBDA_MIN]), W[LAMBDA_MAX]);
}

static void gradient_step(double *S, const double *W, const double *phi, double e, int n) {
  double lambda = S[LAMBDA], spread = 1, slope = 0, largest = 0;
  for (int i = 0; i < n; i++) {
    double total = 0;
    for (int j = 0; j < n; j++) total += S[GRADIENT + i * MOST + j] * phi[j];
    S[SCRATCH + i] = total;
    spread += phi[i] * total;
    slope += phi[i] * S[PSI + i];
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j <= i; j++) {
      double value = S[GRADIENT + i * MOST + j] - S[GAIN + i] * S[SCRATCH + j];
      value += (spread * S[GAIN + i] - S[SCRATCH + i]) * S[GAIN + j];
      value = (value - S[COVARIANCE + i * MOST + j]) / lambda;
      S[GRADIENT + i * MOST + j] = S[GRADIENT + j * MOST + i] = value;
      largest = fmax(largest, fabs(value));
    }
  for (int i = 0; i < n; i++) {
    double total = 0;
    for (int j = 0; j < n; j++) total += S[GRADIENT + i * MOST + j] * phi[j];
    S[PSI + i] += total * e - S[GAIN + i] * slope;
    largest = fmax(largest, fabs(S[PSI + i]));
  }
  if (!(largest < 1e12)) {
    memset(S + GRADIENT, 0, sizeof(double) * MOST * MOST);
    memset(S + PSI, 0, sizeof(double) * n);
    S[DELTA] = W[DELTA_START];
    S[GRADIENT_RESTARTS] += 1;
  }
}

static double perturbation(double *S, const double *W, double e) {
  if ((int)W[SOLVER] == SPRLS) return W[BETA] * rint(W[GAMMA] * e * e);
  S[MEAN_SQUARE] = W[RHO] * S[MEAN_SQUARE] + (1 - W[RHO]) * e * e;
  double excess = S[MEAN_SQUARE] / W[NOISE_VARIANCE] - 1;
  excess = W[ONE_SIDED] > 0 ? fmax(excess, 0) : fabs(excess);
  return W[BETA] * rint(W[GAMMA] * excess);
}

static int recursive_step(double *S, const double *W, const double *phi, double y, double lever,
                          int n) {
  int solver = (int)W[SOLVER];
  double ceiling = W[CEILING] * W[PRIOR] * n, e = y;
  for (int i = 0; i < n; i++) {
    double total = 0;
    e -= phi[i] * S[THETA + i];
    for (int j = 0; j < n; j++) total += S[COVARIANCE + i * MOST + j] * phi[j];
    S[SCRATCH + i] = total;
  }
  S[ERROR] = e;
  double lambda = solver == GN_VFF_RLS ? forgetting_step(S, W, phi, e, n) : S[LAMBDA];
  int healthy = covariance_step(S, phi, lambda, ceiling, n);
  for (int i = 0; i < n; i++) {
    S[THETA + i] += S[GAIN + i] * e;
    lever -= phi[i] * S[SENSITIVITY + i];
  }
  for (int i = 0; i < n; i++) S[SENSITIVITY + i] += S[GAIN + i] * lever;
  if (solver == RLS && W[FORGETTING] == 1) return healthy;
  if (solver == SPRLS || solver == NI_SPRLS) perturb(S, perturbation(S, W, e), ceiling, n);
  else if (solver == GN_VFF_RLS) gradient_step(S, W, phi, e, n);
  propagate(S, phi, n);
  return healthy;
}

static int invert(double *S, int n) {
  double *R = S + COVARIANCE, *C = S + GRADIENT, *scale = S + SCRATCH;
  for (int i = 0; i < n; i++) {
    if (!(R[i * MOST + i] > 1e-100)) return 0;
    scale[i] = 1 / sqrt(R[i * MOST + i]);
    for (int j = 0; j <= i; j++) {
      double total = R[i * MOST + j] * scale[i] * scale[j];
      for (int k = 0; k < j; k++) total -= C[i * MOST + k] * C[j * MOST + k];
      if (j < i) C[i * MOST + j] = total * C[j * MOST + j];
      else if (total > 1e-12) C[i * MOST + i] = 1 / sqrt(total);
      else return 0;
    }
  }
  for (int i = 0; i < n; i++)
    for (int j = 0; j < i; j++) {
      double total = 0;
      for (int k = j; k < i; k++) total -= C[i * MOST + k] * C[k * MOST + j];
      C[i * MOST + j] = total * C[i * MOST + i];
    }
  for (int i = 0; i < n; i++)
    for (int j = 0; j <= i; j++) {
      double total = 0;
      for (int k = i; k < n; k++) total += C[k * MOST + i] * C[k * MOST + j];
      C[j * MOST + i] = total * scale[i] * scale[j];
    }
  for (int i = 0; i < n; i++)
    for (int j = 0; j < i; j++) C[i * MOST + j] = C[j * MOST + i];
  return 1;
}

static int integral_step(double *S, const double *W, const double *phi, double y, double lever,
                         int n) {
  double e = y, lambda = W[FORGETTING], trace = 0;
  for (int i = 0; i < n; i++) e -= phi[i] * S[THETA + i];
  S[ERROR] = e;
  for (int i = 0; i < n; i++) {
    for (int j = 0; j <= i; j++) {
      double value = lambda * S[COVARIANCE + i * MOST + j] + phi[i] * phi[j];
      S[COVARIANCE + i * MOST + j] = S[COVARIANCE + j * MOST + i] = value;
    }
    S[PSI + i] = lambda * S[PSI + i] + phi[i] * y;
    S[SENSITIVITY + i] = lambda * S[SENSITIVITY + i] + phi[i] * lever;
    trace += S[COVARIANCE + i * MOST + i];
  }
  if (trace > 1e15) {
    for (int i = 0; i < MOST * MOST; i++) S[COVARIANCE + i] *= 0.5;
    for (int i = 0; i < n; i++) S[PSI + i] *= 0.5, S[SENSITIVITY + i] *= 0.5;
  }
  if (!invert(S, n)) return S[READY] = 0, 0;
  for (int i = 0; i < n; i++) {
    double total = 0, gain = 0;
    for (int j = 0; j < n; j++) {
      total += S[GRADIENT + i * MOST + j] * S[PSI + j];
      gain += S[GRADIENT + i * MOST + j] * phi[j];
    }
    S[THETA + i] = total, S[GAIN + i] = gain;
  }
  if (lambda < 1) {
    if (S[COUNT] == 0) memcpy(S + PROPAGATED, S + GRADIENT, sizeof(double) * MOST * MOST);
    else propagate(S, phi, n);
  }
  return 1;
}

static void score_step(double *S, const double *W, const double *phi, int n) {
  for (int i = 0; i < n; i++) {
    S[SCORE + i] += phi[i] * S[ERROR];
    S[INFO + i] += phi[i] * phi[i];
  }
  S[BLOCK_COUNT] += 1;
  if (S[BLOCK_COUNT] < W[BLOCK]) return;
  for (int i = 0; i < n; i++) {
    S[SCORE_POWER + i] = 0.995 * S[SCORE_POWER + i] + S[SCORE + i] * S[SCORE + i];
    S[INFO_POWER + i] = 0.995 * S[INFO_POWER + i] + S[INFO + i];
    S[SCORE + i] = S[INFO + i] = 0;
  }
  S[BLOCK_COUNT] = 0;
  S[BLOCKS] += 1;
}

static int judge(double *S, const double *W, const double *phi, int variance, int n) {
  int bounded = 1;
  for (int i = 0; i < n; i++) bounded = bounded && fabs(S[THETA + i]) < 1e9;
  if (bounded && (int64_t)S[COUNT] % 4) return 1;
  double memory = fmax(4 / (S[COUNT] + 4), 4e-3), worst = 0;
  for (int i = 0; i < n; i++) {
    S[EXCITATION + i] += memory * (phi[i] * phi[i] - S[EXCITATION + i]);
    worst = fmax(worst, S[variance + i * MOST + i] * S[EXCITATION + i]);
  }
  if (S[COUNT] < W[WARM_UP]) S[READY] = 0;
  else if (S[READY] > 0) S[READY] = worst < 10;
  else S[READY] = worst < 0.05;
  return bounded;
}

static void row_step(double *S, const double *W, const double *phi, double y, double lever, int n) {
  int sound = fabs(y) < 1e12, healthy = 1, variance = COVARIANCE;
  double size = 0;
  for (int i = 0; i < n; i++) {
    sound = sound && fabs(phi[i]) < 1e12;
    size += fabs(phi[i]);
  }
  if (!sound) {
    S[REJECTED] += 1;
    return;
  }
  if (size == 0) return;
  if ((int)W[SOLVER] == IEC) {
    if (!integral_step(S, W, phi, y, lever, n)) return;
    variance = GRADIENT;
  } else {
    healthy = recursive_step(S, W, phi, y, lever, n);
  }
  S[COUNT] += 1;
  S[SINCE_RESTART] += 1;
  if (!(judge(S, W, phi, variance, n) && healthy)) {
    S[RESTARTS] += 1;
    S[SINCE_RESTART] = 0;
    forget(S, W, n);
  } else if (S[READY] > 0) {
    score_step(S, W, phi, n);
  }
}

void bank_run(double *state, const double *settings, const int64_t *active, const double *phi,
              const double *y, const double *lever, const uint8_t *live, int64_t samples, int64_t rows, int64_t width) {
  for (int64_t i = 0; i < samples; i++)
    for (int64_t r = 0; r < rows; r++) {
      double *S = state + r * ROW_SIZE;
      if (live[r])
        row_step(S, settings + r * N_SETTINGS, phi + (i * rows + r) * width, y[i * rows + r],
                 lever[r], (int)active[r]);
      if (S[RESTARTS] > 0 && S[SINCE_RESTART] < 1000) S[STATUS] = 3;
      else if (S[READY] > 0) S[STATUS] = live[r] ? 1 : 2;
      else S[STATUS] = 0;
    }
}
