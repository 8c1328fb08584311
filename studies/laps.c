// The UKF of one channel as tight as we can write it, to hold the compiled filter against: the runs
// of a sensor side by side, B at a time, so that the processor steps several at once.
#include <math.h>
#define B 32
#define AT(i, u) (slope[i] * (u) + intercept[i])
void laps(const double *restrict slope, const double *restrict intercept, long last, double scale,
          double shift, double step, double q, const double *restrict z,
          const double *restrict noise, const double *restrict size, double R, long n, long runs,
          long cells, double *restrict x, double *restrict P) {
  for (long c = 0; c < cells; c++) for (long first = 0; first < runs; first += B) {
    long count = runs - first < B ? runs - first : B;
    double s[B] = {0}, p[B] = {0}, seen[B] = {0}, top = last;
    for (long r = 0; r < count; r++) s[r] = x[(first + r) * cells + c], p[r] = P[(first + r) * cells + c];
    for (long k = 1; k < n; k++) {
      for (long r = 0; r < count; r++) seen[r] = z[k] + noise[k * runs + first + r] * size[c];
      for (long r = 0; r < B; r++) {
        double at = s[r] + step, var = p[r] + q, root = sqrt(var), reach = 1.7320508075688772 * root * scale;
        double u = at * scale + shift, a = u + reach, b = u - reach;
        int i = fmin(fmax(u, 0), top), j = fmin(fmax(a, 0), top), l = fmin(fmax(b, 0), top);
        double h = AT(i, u), up = AT(j, a), down = AT(l, b);
        double e = (up + down) / 6 + h * 2 / 3, cross = root * (up - down) * (1.7320508075688772 / 6);
        h -= e; up -= e; down -= e;
        double K = cross / (h * h * 2 / 3 + (up * up + down * down) / 6 + R);
        s[r] = at + K * (seen[r] - e); p[r] = var - K * cross;
      }
    }
    for (long r = 0; r < count; r++) x[(first + r) * cells + c] = s[r], P[(first + r) * cells + c] = p[r];
  }
}
