// The UKF of one channel, lap by lap: a plain loop against which `benchmark` holds the compiled one.
#include <math.h>
#define AT(u) (i = (long)(u), i = i < 0 ? 0 : i > last ? last : i, slope[i] * (u) + intercept[i])
void laps(const double *slope, const double *intercept, long last, double scale, double shift,
          double step, double q, const double *z, const double *noise, const double *size, double R,
          long n, long runs, long cells, double *x, double *P) {
  for (long r = 0; r < runs; r++) for (long k = 1; k < n; k++) for (long c = 0; c < cells; c++) {
    long i; double *at = x + r * cells + c, *var = P + r * cells + c;
    double s = *at + step, p = *var + q, root = sqrt(p), reach = 1.7320508075688772 * root;
    double h = AT(s * scale + shift);
    double up = AT((s + reach) * scale + shift), down = AT((s - reach) * scale + shift);
    double e = (up + down) / 6 + h * 2 / 3, cross = root * (up - down) * 1.7320508075688772 / 6;
    h -= e; up -= e; down -= e;
    double S = h * h * 2 / 3 + (up * up + down * down) / 6 + R, K = cross / S;
    *at = s + K * (z[k] + noise[k * runs + r] * size[c] - e);
    *var = p - K * cross;
  }
}
