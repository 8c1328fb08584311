// The device of device.py in C99: one caller, one device, no allocation. `device.c` says more.
#ifndef DEVICE_H
#define DEVICE_H

#include <stdbool.h>

#include "thresholds.h" // from the classes in Python: python tests/device/compiled.py FOLDER

#ifndef REAL
#define REAL float
#endif
#ifndef WIDE
#define WIDE double
#endif
typedef REAL number; // of samples and states
typedef WIDE wide;   // of times and degrees: at 100 deg a step of float is most of a metre

enum { PLACE = 0, SPEED = 2, TILT = 5, GYRO = 8, ACCEL = 11, MOUNT = 14, STATES = 16 };
typedef enum { UNKNOWN = -1, NO, YES } Maybe; // None, False, True

typedef struct {
  wide lat_deg, lon_deg;
  number height_m;
} Place;

typedef struct {
  bool known; // else None
  Place at;
  wide t_s;
  number pdop;
} Stored;

// One GNSS epoch; NaN for a number that is not known.
typedef struct {
  wide t_s;
  bool has_fix;
  Place fix;
  number pdop, speed, course, mode, satellites;
} Epoch;

// What `Device.gnss` returns; NaN without value.
typedef struct {
  bool accepted, moving;
  int layer;
  wide lat_deg, lon_deg;
  number roll, pitch, yaw, mount, ellipse[3];
} Row;

typedef struct {
  Stored position, snapshot, memory, was;
  number sigma, limit, moved_while_off, bridged_s, slip;
  number path, north, east, slack, driven, same_path, before_speed, before_north, before_east;
  bool accepted, doubted, jumped, missed, gives_pdop, has_before;
  wide first_s, saved_at, before_s, since, anchor_s, same_lat, same_lon, same_s;
  Place anchor;
  int epochs, legs;
} LastPosition;

typedef struct {
  Place origin;
  number height, north, east;
} Frame;

typedef struct {
  bool moving;
  Maybe quiet, fast, accelerated;
  number speeds[STATIC_TEST_SPEED_WINDOW], since, ax, ay;
  int count, next;
} StaticTest;

typedef struct {
  bool steady;
  number force[3], rate[3], sum[6], seconds, means[REST_DETECTOR_REST_BLOCKS + !REST_DETECTOR_REST_BLOCKS][6];
  int samples, count, next;
} RestDetector;

typedef struct {
  int layer, far;
  bool has_position;
  number position[3], sums[LOW_PASS_LENGTHS_COUNT][3];
  int counts[LOW_PASS_LENGTHS_COUNT];
} LowPass;

typedef struct {
  number x[3], p, density;
} Direction;

typedef struct {
  number x[3], P[3][3];
} GyroBias;

typedef struct {
  Direction tilt, yaw;
  GyroBias bias;
  bool ready, heading_known;
  number external[3], mean_external[3], vehicle, last[3];
  number turned[3], gyro[3], gyro_square[3], accel[3], seconds;
  int samples;
} Attitude;

typedef struct {
  bool known;
  number mean[3], worth;
} Upright;

typedef struct {
  number course, square, values[4], weight; // values: forward, lateral, ax, ay
} Entry;

typedef struct {
  number mount, sigma, known[11], since, sum[5];
  Entry buffer[MOUNTING_YAW_STRAIGHT_LENGTH];
  int count;
} MountingYaw;

typedef struct {
  bool started;
  number position[3], velocity[3], bias[3], level[6], height[6], waiting_s, sigma_a;
} Fusion;

typedef struct {
  bool started;
  number position[2], velocity[3], C_nb[3][3], C_vb[3][3], gyro_bias[3], accel_bias[3];
  number P[STATES][STATES], error[STATES], seconds, force[3], turned[3], slide, pull[3], later, due;
} Constrained;

typedef struct {
  wide t_s;
  number fix[3], speed, course;
} Fix;

typedef struct {
  bool has_attitude, fuses, has_ned, has_left, gives_speed, moved, rested;
  LastPosition last;
  Frame frame;
  Attitude attitude;
  StaticTest still;
  RestDetector rest;
  LowPass low_pass;
  Upright upright;
  MountingYaw mounting;
  Fusion fusion;
  Constrained *constrained;
  number ned[3], before, pace, lasting, apart, squares[2], unaided, sum[5];
  wide t_imu, t_fusion, t_epoch, t_fix, t_before, shift;
  Fix left, fixes[DEVICE_HELD]; // of the last seconds, one a second
  int held, samples;
} Device;

// `stored` may be NULL; so may `constrained`, the memory of the filter for cars, where it is not
// the one chosen. What `device.last.snapshot` holds is to be kept for the next start.
void device_start(Device *d, const Stored *stored, bool has_imu, Constrained *constrained);
void device_imu(Device *d, wide t_s, const number gyro_b[3], const number accel_b[3]);
Row device_gnss(Device *d, const Epoch *given);

#endif
