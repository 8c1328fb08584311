// Feed a device with samples and epochs from the file log.bin, as feed.py does: its rows go to the
// file rows, what they cost to the file cost. On a Cortex-M4F in an emulator files are the host's.
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "device.h"

enum { VALUES = 32, PAINTED = 4096 / 4 };
#define PAINT 0xA5C35A3Cu

#ifdef __arm__
int main(void);
void initialise_monitor_handles(void);
void _exit(int status);
void reset(void);

typedef void (*Vector)(void);
__attribute__((section(".vectors"), used)) static const Vector vectors[2] = {
    (Vector)0x20100000, reset}; // where the stack begins, and what runs first

#define TIMER ((volatile uint32_t *)0x40000000) // CMSDK: control, value, reload; counts down

void reset(void) {
  *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; // the unit for floats is off at first
  TIMER[2] = TIMER[1] = 0xFFFFFFFFu, TIMER[0] = 1;
  initialise_monitor_handles();
  _exit(main());
}

static uint32_t ticks(void) { return 0xFFFFFFFFu - TIMER[1]; }

// The stack below the caller's is painted before a call; what of it is still so afterwards is free.
__attribute__((noinline)) static uint32_t *below(void) {
  uint32_t *here;
  __asm volatile("mov %0, sp" : "=r"(here));
  return here - 16;
}
static void paint(uint32_t *top) {
  for (int k = 1; k <= PAINTED; k++) ((volatile uint32_t *)top)[-k] = PAINT;
}
static int used(const uint32_t *top) {
  int k = PAINTED;
  while (k > 0 && top[-k] == PAINT) k--;
  return 4 * (k + 16);
}
#else
static uint32_t ticks(void) { return 0; }
static uint32_t *below(void) { return NULL; }
static void paint(uint32_t *top) { (void)top; }
static int used(const uint32_t *top) { return top != NULL; }
#endif

typedef struct {
  const char *name;
  long long calls, ticks, most;
} Cost;

static FILE *events;
static Device device;
static Constrained constrained;
static int deepest;

static int take(double values[VALUES]) {
  double count = 0;
  if (fread(&count, sizeof count, 1, events) != 1 || count > VALUES) return 0;
  return (int)fread(values, sizeof *values, (size_t)count, events);
}

static void count(Cost *cost, uint32_t since, const uint32_t *top) {
  uint32_t now = ticks() - since;
  int depth = used(top);
  cost->calls++, cost->ticks += now;
  if (now > cost->most) cost->most = now;
  if (depth > deepest) deepest = depth;
}

static void say(FILE *file, const Cost *cost) {
  fprintf(file, "%s %lld\n%s_ticks %lld\n%s_most %lld\n", cost->name, cost->calls, cost->name,
          cost->ticks, cost->name, cost->most);
}

static Place place(const double v[3]) {
  return (Place){(wide)v[0], (wide)v[1], (number)v[2]};
}

int main(void) {
  double v[VALUES];
  Cost samples = {"samples", 0, 0, 0}, epochs = {"epochs", 0, 0, 0};
  events = fopen("log.bin", "rb");
  FILE *rows = fopen("rows", "wb"), *cost = fopen("cost", "w");
  if (!events || !rows || !cost || !take(v)) return 1;
  Stored stored = {0};
  const double *at = v + 1; // a field: its length, or -1 for None, or 0 and one number
  if (v[0] > 0) {
    stored = (Stored){true, place(at), (wide)v[4], (number)v[5]};
    at += 5;
  }
  bool has_imu = at[1] > 0;
  device_start(&device, &stored, has_imu, &constrained);
  for (int n; (n = take(v)) > 0;) {
    uint32_t *top = below();
    wide t_s = (wide)v[1];
    if (n == 2) { // switched off and on
      stored = device.last.snapshot;
      device_start(&device, &stored, has_imu, &constrained);
    } else if (n == 10 && v[2] > 2.5) { // t_s, gyro_b, accel_b
      number gyro[3], accel[3];
      for (int k = 0; k < 3; k++) gyro[k] = (number)v[3 + k], accel[k] = (number)v[7 + k];
      paint(top);
      uint32_t since = ticks();
      device_imu(&device, t_s, gyro, accel);
      count(&samples, since, top);
    } else {
      bool fixed = v[2] > 0;
      const double *o = v + (fixed ? 6 : 3); // the others, each after its length
      Epoch epoch = {.t_s = t_s, .has_fix = fixed, .fix = place(v + 3), .pdop = (number)o[1],
                     .speed = (number)o[3], .course = (number)o[5], .mode = (number)o[7],
                     .satellites = (number)o[9]};
      paint(top);
      uint32_t since = ticks();
      Row r = device_gnss(&device, &epoch);
      count(&epochs, since, top);
      double out[12] = {r.accepted, r.moving, r.layer, (double)r.lat_deg, (double)r.lon_deg,
                        r.roll, r.pitch, r.yaw, r.mount,
                        r.ellipse[0], r.ellipse[1], r.ellipse[2]};
      fwrite(out, sizeof *out, 12, rows);
    }
  }
  say(cost, &samples);
  say(cost, &epochs);
  fprintf(cost, "stack %d\ndevice %d\nconstrained %d\n", deepest, (int)sizeof device,
          (int)sizeof constrained);
  fclose(rows);
  return fclose(cost);
}
