// The six blocks and the filter for cars, as `device.py` joins them, in C99 for a microcontroller.
//
// A function is the Python function whose name it has: `attitude_imu` is `Attitude.imu`; where the
// names differ a comment says which. Why a block does what it does is told in its Python file. The
// thresholds are not here: `thresholds.h` is written from the classes. None is NaN, or a flag that
// is off. Left out is what no output needs: eq (3) as printed, and the report of each straight.
//
// No allocation, no recursion, no globals; the stack needs a kilobyte. Buffers have fixed lengths,
// and a mean needs the sum alone.
#include "device.h"

#include <math.h>
#include <stddef.h>

#define R(x) ((number)(x))
#define PI 3.14159265358979323846
#define GRAVITY R(VECTORS_STANDARD_GRAVITY)
#define SQUARE(x) ((x) * (x))
#define EACH(i, n) for (int i = 0; i < (n); i++)

// The functions of `math` in the type of the number. <tgmath.h> does not compile with newlib.
#define ONE(name, of)                                                                              \
  static inline number name(number x) {                                                            \
    return sizeof(number) == sizeof(float) ? R(of##f((float)x)) : R(of((double)x));                \
  }
#define TWO(name, of)                                                                              \
  static inline number name(number x, number y) {                                                  \
    return sizeof(number) == sizeof(float) ? R(of##f((float)x, (float)y))                          \
                                           : R(of((double)x, (double)y));                          \
  }
ONE(root, sqrt)
ONE(sine, sin)
ONE(cosine, cos)
ONE(arcsine, asin)
ONE(size, fabs)
TWO(arctangent, atan2)
TWO(modulo, fmod)

static const number NONE = R(NAN); // of Python

// `max` and `min` of Python, which keep the first where a number is not known.
static number most(number a, number b) { return b > a ? b : a; }
static number least(number a, number b) { return b < a ? b : a; }
static wide latest(wide a, wide b) { return b > a ? b : a; }
static bool known(number x) { return x == x; }
static bool is_time(wide t) { return t == t; }
static number or_zero(number x) { return known(x) ? x : 0; }

// vectors.py

static number wrap(number angle) {
  number rest = modulo(R(PI) - angle, R(2 * PI));
  return R(PI) - (rest < 0 ? rest + R(2 * PI) : rest);
}

static number dot(const number a[3], const number b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(number out[3], const number a[3], const number b[3]) {
  number x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0], out[0] = x, out[1] = y;
}

static void unit(number a[3]) {
  number scale = 1 / root(dot(a, a));
  EACH(k, 3) a[k] *= scale;
}

static void add(number total[3], const number values[3]) { EACH(k, 3) total[k] += values[k]; }
static void copy(number to[3], const number from[3]) { EACH(k, 3) to[k] = from[k]; }
static void zero(number a[3]) { EACH(k, 3) a[k] = 0; }

// last_position.py

static number pdop_sigma(number pdop) { // _sigma
  if (!known(pdop)) return LAST_POSITION_SIGMA_NO_PDOP;
  return most(LAST_POSITION_METRES_PER_PDOP, LAST_POSITION_METRES_PER_PDOP * pdop);
}

static number norm(number a, number b) { return root(a * a + b * b); }

static wide turned_back(wide degrees) { // _turned, of two turns at most
  for (int k = 0; k < 2 && !(-180 < degrees && degrees <= 180); k++)
    degrees += (wide)(degrees > 180 ? -360 : 360);
  return degrees;
}

static void metres_per_degree(number lat_deg, number height_m, number *north, number *east) {
  number height = or_zero(height_m), flat = LAST_POSITION_FLATTENING;
  number squared = flat * (2 - flat), degree = R(PI / 180), lat = lat_deg * degree;
  number s = sine(lat), left = 1 - squared * s * s;
  number across = LAST_POSITION_RADIUS_M / root(left);
  *north = degree * (across * (1 - squared) / left + height);
  *east = degree * (across + height) * cosine(lat);
}

static number distance(const Place *a, const Place *b) {
  number north, east;
  metres_per_degree(R((a->lat_deg + b->lat_deg) / 2), 0, &north, &east);
  return norm(R(b->lat_deg - a->lat_deg) * north, R(turned_back(b->lon_deg - a->lon_deg)) * east);
}

static void frame_start(Frame *f, const Place *origin) { // Frame.__init__
  f->origin = *origin;
  f->height = or_zero(origin->height_m);
  metres_per_degree(R(origin->lat_deg), f->height, &f->north, &f->east);
}

static void frame_ned(const Frame *f, const Place *fix, number out[3]) {
  out[0] = R(fix->lat_deg - f->origin.lat_deg) * f->north;
  out[1] = R(turned_back(fix->lon_deg - f->origin.lon_deg)) * f->east;
  out[2] = f->height - (known(fix->height_m) ? fix->height_m : f->height);
}

static void last_start(LastPosition *b, const Stored *stored) { // LastPosition.__init__
  *b = (LastPosition){.saved_at = -INFINITY, .same_lat = NAN, .same_lon = NAN, .first_s = NAN};
  if (stored && stored->known) {
    b->position = b->snapshot = b->memory = *stored;
    b->sigma = pdop_sigma(stored->pdop);
  }
  b->moved_while_off = NONE, b->driven = INFINITY, b->legs = 1;
}

static void last_motion(LastPosition *b) {
  if (!b->accepted) b->position.known = b->memory.known = false;
}

static bool last_repeated(LastPosition *b, wide t_s, const Place *fix, number speed) {
  bool same = fix->lat_deg == b->same_lat && fix->lon_deg == b->same_lon;
  bool adds = same && speed > LAST_POSITION_SLOW;
  b->same_path = adds ? b->same_path + speed * R(t_s - b->same_s) : 0;
  b->same_lat = fix->lat_deg, b->same_lon = fix->lon_deg, b->same_s = t_s;
  return b->same_path > LAST_POSITION_MISS_M;
}

static bool last_passes(const LastPosition *b, number pdop, wide t_s) {
  if (known(pdop) || LAST_POSITION_PDOP_GATE == R(INFINITY)) return true;
  return !b->gives_pdop && t_s - b->first_s >= (wide)LAST_POSITION_PDOP_WAIT_S;
}

static bool last_doubted(number mode, number satellites) {
  if (satellites < LAST_POSITION_SATELLITES) return true;
  return LAST_POSITION_THREE_D && mode < 3 && !(satellites >= LAST_POSITION_ENOUGH);
}

static void last_save(LastPosition *b, const Stored *here, number speed) {
  wide since = here->t_s - b->saved_at;
  bool stopped = false;
  if (b->snapshot.known && speed < LAST_POSITION_SLOW) {
    number far = distance(&b->snapshot.at, &here->at);
    stopped = far > LAST_POSITION_NEAR * pdop_sigma(b->snapshot.pdop);
  }
  if (since >= (wide)LAST_POSITION_SAVE_EVERY_S || (stopped && since >= (wide)LAST_POSITION_LOST_S))
    b->snapshot = *here, b->saved_at = here->t_s;
}

static void last_drop_anchor(LastPosition *b, wide t_s, const Place *fix) {
  b->anchor = *fix, b->anchor_s = t_s, b->epochs = 0;
  b->path = b->north = b->east = b->slack = 0;
}

static wide last_anew(LastPosition *b, wide t_s, const Place *fix) {
  b->since = t_s;
  last_drop_anchor(b, t_s, fix);
  return 0;
}

// In seconds as wide as times: a wait of 5 s is over or not, whatever the type of the number.
static wide last_agreed(LastPosition *b, wide t_s, const Place *fix, number speed, number course) {
  number north = speed * cosine(course), east = speed * sine(course);
  bool had = b->has_before;
  wide before_s = b->before_s, apart = had ? t_s - before_s : (wide)INFINITY;
  number last_speed = b->before_speed, last_north = b->before_north, last_east = b->before_east;
  b->has_before = true, b->before_s = t_s;
  b->before_speed = speed, b->before_north = north, b->before_east = east;
  if (!(0 < apart && apart <= (wide)LAST_POSITION_LOST_S)) {
    bool rare = (wide)LAST_POSITION_LOST_S < apart && apart < (wide)INFINITY && b->since == before_s;
    wide agreed_s = last_anew(b, t_s, fix);
    b->missed = false, b->driven = INFINITY;
    if (b->accepted || rare)
      agreed_s = (wide)LAST_POSITION_SETTLE_S, b->since = t_s - agreed_s;
    return agreed_s;
  }
  number dt = R(apart), mean = (speed + last_speed) / 2;
  number step = dt * (known(mean) ? mean : LAST_POSITION_FASTEST);
  b->path += step;
  b->driven += step;
  b->north += dt * (north + last_north) / 2;
  b->east += dt * (east + last_east) / 2;
  b->epochs++;
  if (dt > 1) b->slack += LAST_POSITION_SLACK * SQUARE(dt - 1);
  number to_north, to_east, miss;
  metres_per_degree(R(fix->lat_deg), fix->height_m, &to_north, &to_east);
  number moved_n = R(fix->lat_deg - b->anchor.lat_deg) * to_north;
  number moved_e = R(turned_back(fix->lon_deg - b->anchor.lon_deg)) * to_east;
  if (known(b->north)) miss = norm(moved_n - b->north, moved_e - b->east);
  else miss = norm(moved_n, moved_e) - b->path;
  if (miss > LAST_POSITION_MISS_M + LAST_POSITION_MISS_SHARE * b->path + b->slack) {
    b->missed = true;
    return last_anew(b, t_s, fix);
  }
  wide seconds = t_s - b->anchor_s;
  if (seconds >= (wide)(2 * LAST_POSITION_SETTLE_S)) {
    number s = R(seconds);
    if (known(b->north) && b->path > LAST_POSITION_SLOW * s) {
      b->legs = b->legs < LAST_POSITION_LEGS ? b->legs + 1 : LAST_POSITION_LEGS;
      number square = miss * miss * R(b->epochs) / (2 * s * s);
      b->slip += (square - b->slip) / R(b->legs);
    }
    last_drop_anchor(b, t_s, fix);
  }
  return t_s - b->since;
}

static bool last_step(LastPosition *b, const Epoch *e) {
  number pdop = e->pdop, speed = e->speed;
  wide t_s = e->t_s, agreed_s = 0;
  if (!e->has_fix) return false;
  if (!is_time(b->first_s)) b->first_s = t_s;
  b->gives_pdop = b->gives_pdop || known(pdop);
  if (pdop > LAST_POSITION_PDOP_GATE) return false;
  if (LAST_POSITION_SETTLE_S > 0 || LAST_POSITION_DOUBT_S > 0) {
    if (last_repeated(b, t_s, &e->fix, speed)) return false;
    agreed_s = last_agreed(b, t_s, &e->fix, speed, e->course);
  }
  if (!last_passes(b, pdop, t_s)) return false;
  Stored here = {true, e->fix, t_s, pdop};
  bool doubted = last_doubted(e->mode, e->satellites);
  if (doubted && !(LAST_POSITION_DOUBT_S > 0)) return false;
  number moved = 0, apart = 0;
  const Stored *before = b->accepted ? &b->position : &b->memory;
  if (before->known) {
    moved = distance(&before->at, &here.at);
    apart = norm(pdop_sigma(pdop), b->sigma);
  }
  number wait_s = doubted ? LAST_POSITION_DOUBT_S : LAST_POSITION_SETTLE_S;
  if (b->memory.known && moved > LAST_POSITION_FAR * apart) {
    bool drives = b->path + speed > LAST_POSITION_MISS_M;
    if (!drives) wait_s = LAST_POSITION_DOUBT_S;
    if (drives || (agreed_s >= (wide)LAST_POSITION_SETTLE_S && !doubted)) b->position.known = false;
  } else if (!doubted && moved < LAST_POSITION_NEAR * apart) {
    wait_s = 0;
  } else if (b->accepted) {
    bool lost = speed > LAST_POSITION_SLOW && t_s - before->t_s > (wide)b->bridged_s;
    if (lost || b->doubted) wait_s = LAST_POSITION_SETTLE_S;
  }
  if (agreed_s < (wide)wait_s) return false;
  if (b->memory.known) {
    number limit = LAST_POSITION_MOVED_M, wide_of = LAST_POSITION_FAR * apart;
    b->limit = LAST_POSITION_DOUBT_S > 0 ? most(limit, wide_of) : limit;
    b->was = b->memory;
    b->moved_while_off = moved > b->limit ? moved : NONE;
    b->driven = LAST_POSITION_DOUBT_S > 0 ? 0 : R(INFINITY);
  } else if (known(b->moved_while_off) && b->driven < LAST_POSITION_MOVED_M) {
    if (distance(&b->was.at, &here.at) < b->limit) b->moved_while_off = NONE;
  }
  b->accepted = true;
  b->position = here, b->memory.known = false, b->doubted = doubted;
  b->sigma = doubted ? LAST_POSITION_SIGMA_DOUBTED : pdop_sigma(pdop);
  b->jumped = b->missed, b->missed = false;
  last_save(b, &here, speed);
  return true;
}

// at_rest.py

static bool static_judge(StaticTest *b) { // StaticTest._judge
  bool unknown = b->fast == UNKNOWN && b->accelerated == UNKNOWN;
  bool loud = b->moving && b->quiet == NO;
  b->moving = unknown || b->fast == YES || b->accelerated == YES || loud;
  return b->moving;
}

static bool static_accelerate(StaticTest *b, number ax, number ay, number dt) {
  number share = dt < STATIC_TEST_ACCEL_TAU_S ? dt / STATIC_TEST_ACCEL_TAU_S : 1;
  b->ax = b->ax + share * (ax - b->ax);
  b->ay = b->ay + share * (ay - b->ay);
  b->accelerated = norm(b->ax, b->ay) > STATIC_TEST_THETA_A ? YES : NO;
  return static_judge(b);
}

static void static_no_imu(StaticTest *b) {
  b->accelerated = b->quiet = UNKNOWN, b->ax = b->ay = 0;
}

static bool static_drive(StaticTest *b, number speed, number dt) {
  b->since += dt;
  if (known(speed)) {
    if (b->since + R(0.5) * dt >= AT_REST_EVERY_S) {
      b->speeds[b->next] = speed, b->since = 0;
      b->next = (b->next + 1) % STATIC_TEST_SPEED_WINDOW;
      if (b->count < STATIC_TEST_SPEED_WINDOW) b->count++;
    }
    number total = 0;
    EACH(k, b->count) total += b->speeds[k];
    bool fast = total / R(b->count) > STATIC_TEST_SPEED_THRESHOLD || speed > STATIC_TEST_WAKE_SPEED;
    b->fast = fast ? YES : NO;
  }
  return static_judge(b);
}

static void rest_clear(RestDetector *b) {
  EACH(k, 6) b->sum[k] = 0;
  b->samples = 0, b->seconds = 0;
}

static void rest_reset(RestDetector *b) {
  b->steady = false, b->count = b->next = 0;
  rest_clear(b);
}

static bool rest_test(RestDetector *b) {
  number means[6] = {0}, squares[6] = {0};
  EACH(n, b->count) EACH(k, 6) means[k] += b->means[n][k];
  EACH(k, 6) means[k] /= R(b->count);
  EACH(n, b->count) EACH(k, 6) squares[k] += SQUARE(b->means[n][k] - means[k]);
  number rate = (squares[0] + squares[1] + squares[2]) / SQUARE(AT_REST_SIGMA_RATE);
  number force = (squares[3] + squares[4] + squares[5]) / SQUARE(AT_REST_SIGMA_FORCE);
  copy(b->rate, means);
  copy(b->force, means + 3);
  return (rate + force) / R(b->count) < 1;
}

static bool rest_sample(RestDetector *b, const number gyro[3], const number accel[3], number dt) {
  if (dt > AT_REST_GAP_S) rest_reset(b);
  add(b->sum, gyro);
  add(b->sum + 3, accel);
  b->samples++;
  b->seconds += dt;
  if (b->seconds + R(0.5) * dt < AT_REST_BLOCK_S) return false;
  number scale = 1 / R(b->samples);
  EACH(k, 6) b->means[b->next][k] = b->sum[k] * scale;
  b->next = b->next + 1 < REST_DETECTOR_REST_BLOCKS ? b->next + 1 : 0;
  if (b->count < REST_DETECTOR_REST_BLOCKS) b->count++;
  rest_clear(b);
  if (b->count < REST_DETECTOR_REST_BLOCKS) return false;
  b->steady = rest_test(b);
  return b->steady;
}

static void low_pass_reset(LowPass *b) { *b = (LowPass){0}; }

static bool low_pass_jumped(LowPass *b, const number position[3]) {
  number square = 0;
  EACH(k, 3) square += SQUARE(position[k] - b->position[k]);
  b->far = square > SQUARE(LOW_PASS_JUMP_M) ? b->far + 1 : 0;
  return b->far >= AT_REST_JUMP_FIXES;
}

static void low_pass_step(LowPass *b, const number position[3]) {
  static const int lengths[] = LOW_PASS_LENGTHS;
  bool jumps = b->has_position && LOW_PASS_JUMP_M < R(INFINITY);
  if (jumps && low_pass_jumped(b, position)) low_pass_reset(b);
  number entry[3];
  copy(entry, position);
  EACH(k, LOW_PASS_LENGTHS_COUNT) {
    add(b->sums[k], entry);
    if (++b->counts[k] < lengths[k]) break;
    EACH(i, 3) entry[i] = b->sums[k][i] / R(b->counts[k]);
    zero(b->sums[k]);
    b->counts[k] = 0;
    if (k + 1 >= b->layer) {
      b->layer = k + 1, b->has_position = true;
      copy(b->position, entry);
    }
  }
}

// attitude.py

static void opposite(number out[3], const number force[3]) {
  number scale = -1 / most(root(dot(force, force)), ATTITUDE_WEIGHTLESS);
  EACH(k, 3) out[k] = force[k] * scale;
}

static void north_of(number out[3], const number down[3], number heading) { // north
  number d0 = down[0], d1 = down[1], d2 = down[2], left = 1 - d0 * d0;
  number c = cosine(heading), s = sine(heading);
  if (left < ATTITUDE_ON_END) {
    out[0] = 0, out[1] = -s, out[2] = -d0 * c;
    return;
  }
  number scale = 1 / root(left);
  c *= scale, s *= scale;
  out[0] = c * left, out[1] = -c * d0 * d1 - s * d2, out[2] = -c * d0 * d2 + s * d1;
}

static void level(const number v[3], const number down[3], number *ax, number *ay) {
  number left = 1 - down[0] * down[0];
  if (left < ATTITUDE_ON_END) {
    *ax = -down[0] * v[2], *ay = v[1];
    return;
  }
  number scale = 1 / root(left);
  *ax = (v[0] - down[0] * dot(v, down)) * scale;
  *ay = (down[2] * v[1] - down[1] * v[2]) * scale;
}

static void angles_of(number C[3][3], Row *row) { // angles
  row->roll = arctangent(C[2][1], C[2][2]);
  row->pitch = -arcsine(most(-1, least(1, C[2][0])));
  row->yaw = arctangent(C[1][0], C[0][0]);
}

static void direction_rate_error(Direction *d, number variance) { // Direction.set_rate_error
  d->density = SQUARE(ATTITUDE_GYRO_ARW) + variance * ATTITUDE_BIAS_ERROR_S;
}

static void direction_start(Direction *d, const number x[3], number sigma) {
  copy(d->x, x);
  d->p = sigma * sigma;
}

// Turn a vector that is fixed in navigation axes by Cayley's form of a rotation, in body axes.
static void cayley(number v[3], const number a[3]) {
  number u[3], twice[3], s = 2 / (1 + dot(a, a));
  cross(u, a, v);
  cross(twice, a, u);
  EACH(k, 3) v[k] -= s * (u[k] - twice[k]);
}

static void direction_predict(Direction *d, const number a[3], number dt) {
  cayley(d->x, a);
  d->p += d->density * dt;
}

static void direction_update(Direction *d, const number z[3], number variance) {
  number gain = d->p / (d->p + variance);
  d->p = gain * variance;
  EACH(k, 3) d->x[k] += gain * (z[k] - d->x[k]);
  unit(d->x);
}

static void bias_start(GyroBias *b, const number x[3], number sigma) { // GyroBiasFilter.start
  copy(b->x, x);
  EACH(i, 3) EACH(j, 3) b->P[i][j] = i == j ? sigma * sigma : 0;
}

static void bias_predict(GyroBias *b, number dt) {
  EACH(i, 3) b->P[i][i] += SQUARE(ATTITUDE_BIAS_WALK) * dt;
}

static void bias_update(GyroBias *b, const number axis[3], number value, number variance) {
  number Ph[3];
  EACH(i, 3) Ph[i] = dot(b->P[i], axis);
  number gain = 1 / (dot(Ph, axis) + variance), step = gain * (value - dot(b->x, axis));
  EACH(i, 3) b->x[i] += step * Ph[i];
  EACH(i, 3) for (int j = i; j < 3; j++) {
    b->P[i][j] -= gain * (Ph[i] * Ph[j]);
    b->P[j][i] = b->P[i][j];
  }
}

static void bias_rest(GyroBias *b, const number mean[3], number dt, const number variance[3]) {
  bias_predict(b, dt);
  EACH(i, 3) {
    number axis[3] = {i == 0, i == 1, i == 2};
    bias_update(b, axis, mean[i], SQUARE(ATTITUDE_SIGMA_BIAS_REST) + most(variance[i], 0));
  }
}

static void attitude_clear_sums(Attitude *b) {
  zero(b->turned), zero(b->gyro), zero(b->gyro_square), zero(b->accel);
  b->samples = 0, b->seconds = 0;
}

static void attitude_start(Attitude *b) { // Attitude.__init__
  *b = (Attitude){.vehicle = NONE};
  number down[3] = {0, 0, 1}, none[3] = {0};
  direction_start(&b->tilt, down, 1);
  direction_start(&b->yaw, down, 1);
  direction_rate_error(&b->tilt, SQUARE(ATTITUDE_SIGMA_BIAS_START));
  direction_rate_error(&b->yaw, SQUARE(ATTITUDE_SIGMA_BIAS_START));
  bias_start(&b->bias, none, ATTITUDE_SIGMA_BIAS_START);
}

static void attitude_C_nb(const Attitude *b, number C[3][3]) {
  const number *down = b->tilt.x;
  number along = dot(b->yaw.x, down);
  EACH(i, 3) C[0][i] = b->yaw.x[i] - along * down[i];
  if (dot(C[0], C[0]) < ATTITUDE_ON_END) north_of(C[0], down, 0);
  else unit(C[0]);
  cross(C[1], down, C[0]);
  copy(C[2], down);
}

static void attitude_angles(const Attitude *b, Row *row) {
  if (!b->ready) return; // they are NaN
  number C[3][3];
  attitude_C_nb(b, C);
  angles_of(C, row);
  if (!b->heading_known) row->yaw = NONE;
}

static number attitude_yaw_rate(const Attitude *b) {
  if (!b->ready || !b->samples) return NONE;
  return dot(b->gyro, b->tilt.x) / R(b->samples) - dot(b->bias.x, b->tilt.x);
}

static void attitude_accel_n(const Attitude *b, number out[3]) {
  number C[3][3];
  attitude_C_nb(b, C);
  EACH(i, 3) out[i] = dot(C[i], b->external);
}

static number attitude_accel_variance(const Attitude *b, number dt) {
  number lasting = b->vehicle, shaken[3];
  if (!known(lasting))
    lasting = least(dot(b->mean_external, b->mean_external), SQUARE(ATTITUDE_EXTERNAL_MOST));
  lasting = most(lasting, SQUARE(ATTITUDE_EXTERNAL_LEAST));
  EACH(k, 3) shaken[k] = b->external[k] - b->mean_external[k];
  return SQUARE(ATTITUDE_SIGMA_ACCEL) + dot(shaken, shaken) +
         lasting * (2 * ATTITUDE_EXTERNAL_CORR_S / dt);
}

static void attitude_align(Attitude *b, const number accel_b[3]) {
  add(b->accel, accel_b);
  number short_by = sizeof(number) == sizeof(float) ? R(1e-6) : 0; // a sum of steps in float
  if (b->seconds < ATTITUDE_ALIGN_S - short_by || b->samples < 3) return;
  number force[3], ahead[3];
  EACH(k, 3) force[k] = b->accel[k] / R(b->samples);
  attitude_clear_sums(b);
  if (dot(force, force) < SQUARE(ATTITUDE_WEIGHTLESS)) return;
  opposite(b->tilt.x, force);
  direction_start(&b->tilt, b->tilt.x, R(0.1));
  north_of(ahead, b->tilt.x, 0);
  direction_start(&b->yaw, ahead, R(PI));
  EACH(k, 3) b->external[k] = accel_b[k] + GRAVITY * b->tilt.x[k];
  copy(b->mean_external, b->external);
  b->ready = true;
}

static void attitude_imu(Attitude *b, const number gyro[3], const number accel[3], number dt,
                         bool is_static) {
  if (dt > ATTITUDE_GAP_S) {
    b->ready = b->heading_known = false;
    attitude_clear_sums(b);
    dt = 0;
  }
  number change[3];
  EACH(k, 3) change[k] = gyro[k] - b->last[k];
  copy(b->last, gyro);
  add(b->gyro, gyro);
  EACH(k, 3) b->gyro_square[k] += gyro[k] * gyro[k];
  b->samples++;
  b->seconds += dt;
  if (!b->ready) {
    attitude_align(b, accel);
    return;
  }
  number a[3], z[3], before[3], turn[3], scale = -1 / GRAVITY;
  EACH(k, 3) a[k] = R(0.5) * dt * (gyro[k] - R(0.5) * change[k] - b->bias.x[k]);
  direction_predict(&b->yaw, a, dt);
  direction_predict(&b->tilt, a, dt);
  copy(before, b->tilt.x);
  if (!is_static) b->tilt.p += R(0.5) * dt * dt * dot(change, change);
  number variance = SQUARE(ATTITUDE_SIGMA_ACCEL);
  if (!is_static) variance = attitude_accel_variance(b, dt);
  EACH(k, 3) z[k] = accel[k] * scale;
  direction_update(&b->tilt, z, variance * scale * scale);
  number share = dt < ATTITUDE_EXTERNAL_TAU_S ? dt / ATTITUDE_EXTERNAL_TAU_S : 1;
  EACH(k, 3) {
    b->external[k] = accel[k] + GRAVITY * b->tilt.x[k];
    b->mean_external[k] += share * (b->external[k] - b->mean_external[k]);
  }
  cross(turn, before, b->tilt.x);
  add(b->turned, turn);
}

static void attitude_restart(Attitude *b, const number force[3], const number rate[3]) {
  number down[3], ahead, right;
  level(b->yaw.x, b->tilt.x, &ahead, &right);
  bias_start(&b->bias, rate, ATTITUDE_SIGMA_BIAS_REST);
  opposite(down, force);
  direction_start(&b->tilt, down, ATTITUDE_SIGMA_ACCEL / GRAVITY);
  north_of(b->yaw.x, down, arctangent(-right, ahead));
  zero(b->mean_external);
}

static void attitude_correct_bias(Attitude *b, bool is_static, const number down[3], number spin) {
  number seconds = b->seconds, scale = 1 / R(b->samples), mean[3], variance[3], turned[3], right[3];
  if (is_static) {
    EACH(k, 3) {
      mean[k] = b->gyro[k] * scale;
      variance[k] = (b->gyro_square[k] * scale - mean[k] * mean[k]) * scale;
    }
    bias_rest(&b->bias, mean, seconds, variance);
    return;
  }
  bias_predict(&b->bias, seconds);
  if (known(b->vehicle)) {
    number noise = ATTITUDE_SIGMA_BIAS_MOVING * (1 + b->vehicle);
    EACH(k, 3) turned[k] = b->bias.x[k] + b->turned[k] / seconds;
    cross(right, down, b->yaw.x);
    bias_update(&b->bias, b->yaw.x, dot(b->yaw.x, turned), noise * noise / seconds);
    bias_update(&b->bias, right, dot(right, turned), noise * noise / seconds);
  }
  if (known(spin)) {
    number measured = dot(down, b->bias.x) + spin / seconds;
    bias_update(&b->bias, down, measured, SQUARE(ATTITUDE_SIGMA_BIAS_MOVING) / seconds);
  }
}

static void attitude_set_rate_errors(Attitude *b, const number down[3]) {
  number(*P)[3] = b->bias.P, scale = SQUARE(ATTITUDE_GYRO_SCALE), along = 0, turning = 0, rest = 0;
  EACH(k, 3) {
    number square = b->gyro_square[k] / R(b->samples);
    along += dot(P[k], down) * down[k];
    turning += square * (down[k] * down[k]);
    rest += square;
  }
  rest = most(rest - turning, 0);
  number trace = P[0][0] + P[1][1] + P[2][2];
  direction_rate_error(&b->tilt, (trace - along + scale * rest) / 2);
  direction_rate_error(&b->yaw, along + scale * turning);
}

// Without a heading it is NaN; so is the square of an acceleration that GNSS does not tell.
static void attitude_epoch(Attitude *b, bool is_static, number heading, number sigma,
                           number vehicle) {
  b->vehicle = vehicle;
  if (!b->ready || !b->samples) return;
  number *down = b->tilt.x, target[3], C[3][3], spin = NONE;
  attitude_C_nb(b, C);
  copy(b->yaw.x, C[0]);
  if (known(heading)) {
    north_of(target, down, heading);
    if (b->heading_known) {
      direction_update(&b->yaw, target, sigma * sigma);
      cross(C[0], C[0], b->yaw.x);
      spin = dot(C[0], down);
    } else {
      direction_start(&b->yaw, target, sigma);
      b->heading_known = true;
    }
  }
  attitude_correct_bias(b, is_static, down, spin);
  attitude_set_rate_errors(b, down);
  attitude_clear_sums(b);
}

static void upright_start(Upright *b, const number force[3]) {
  b->known = true, b->worth = ATTITUDE_REST_S;
  copy(b->mean, force);
}

static void upright_step(Upright *b, const number force[3], number dt) {
  b->worth = least(b->worth + dt, ATTITUDE_UPRIGHT_S);
  number share = least(dt / b->worth, 1);
  EACH(k, 3) b->mean[k] += share * (force[k] - b->mean[k]);
}

// mounting.py

static void mounting_interrupt(MountingYaw *b) { b->count = 0, b->since = NONE; }

static void mounting_start(MountingYaw *b) { // MountingYaw.__init__
  *b = (MountingYaw){.mount = NONE, .sigma = NONE};
  mounting_interrupt(b);
}

// Add the products of four values with one another, each pair once (_products).
static void add_products(number sums[10], const number v[4], number weight) {
  int n = 0;
  EACH(i, 4) for (int j = i; j < 4; j++) sums[n++] += weight * (v[i] * v[j]);
}

static void fit(const MountingYaw *b, number sums[11]) {
  number means[4] = {0}, total = 1 / SQUARE(MOUNTING_YAW_SIGMA_LEVEL);
  EACH(k, 11) sums[k] = 0;
  EACH(n, b->count) {
    const Entry *e = &b->buffer[n];
    total += e->weight;
    EACH(k, 4) means[k] += e->weight * e->values[k];
    add_products(sums, e->values, e->weight);
  }
  add_products(sums, means, -1 / total);
  sums[10] = R(b->count - 1);
}

static void weighted_angle(const number s[11], number *angle, number *sigma, number *slope) {
  number ff = s[0], fl = s[1], fx = s[2], fy = s[3], lx = s[5], ly = s[6];
  number xx = s[7], xy = s[8], yy = s[9], freedom = s[10];
  number ll = s[4] + 1 / SQUARE(MOUNTING_SIGMA_LATERAL), info = ff - fl * fl / ll;
  number along_x = fx - fl * lx / ll, along_y = fy - fl * ly / ll, length = norm(along_x, along_y);
  *angle = 0, *sigma = INFINITY, *slope = 0;
  if (info <= 0 || length <= 0) return;
  number c = along_x / length, sn = along_y / length, lateral = c * ly - sn * lx;
  number left = sn * sn * xx - 2 * sn * c * xy + c * c * yy - lateral * lateral / ll;
  number scatter = (MOUNTING_ASSUMED + left) / (MOUNTING_ASSUMED + freedom);
  *slope = length / info;
  *angle = arctangent(along_y, along_x);
  *sigma = root(scatter / info) / *slope;
}

static number course_variance(const MountingYaw *b) {
  number total = 0, centre = 0, squares = 0, turned[MOUNTING_YAW_STRAIGHT_LENGTH];
  EACH(k, b->count) {
    turned[k] = wrap(b->buffer[k].course - b->buffer[0].course);
    total += b->buffer[k].square;
    centre += b->buffer[k].square * turned[k];
  }
  centre /= total;
  EACH(k, b->count) squares += b->buffer[k].square * SQUARE(turned[k] - centre);
  return squares / total;
}

static number bend_variance(const MountingYaw *b, number seconds, number lateral) {
  number square = 0, turned = lateral * seconds;
  EACH(k, b->count) square += b->buffer[k].square;
  return turned * turned / (12 * (square / R(b->count)));
}

static bool mounting_straight(MountingYaw *b) {
  number sums[11], angle, sigma, slope, keep = 1;
  static const number slopes[] = MOUNTING_YAW_SLOPE;
  fit(b, sums);
  if (b->known[0] > 0) {
    number share = (MOUNTING_ENOUGH - sums[0]) / b->known[0];
    keep = most(MOUNTING_YAW_KEEP, least(1, share));
  }
  EACH(k, 11) b->known[k] = keep * b->known[k] + sums[k];
  weighted_angle(b->known, &angle, &sigma, &slope);
  bool good = sigma <= MOUNTING_YAW_MAX_MOUNT_SIGMA && slopes[0] <= slope && slope <= slopes[1];
  if (good) b->mount = wrap(-angle), b->sigma = sigma;
  return good;
}

static bool mounting_step(MountingYaw *b, number dt, number course, number speed, number yaw_rate,
                          number ax, number ay, number variance) {
  bool fast = speed >= MOUNTING_YAW_MIN_SPEED;
  if (!fast || !known(course) || dt > 2 * MOUNTING_YAW_ENTRY_S + 1) {
    mounting_interrupt(b);
    return false;
  }
  if (!known(b->since)) {
    b->since = speed;
    EACH(k, 5) b->sum[k] = 0;
    return false;
  }
  number means[5] = {ax, ay, speed * yaw_rate, variance, 1};
  EACH(k, 5) b->sum[k] += means[k] * dt;
  number seconds = b->sum[4];
  if (seconds + R(0.5) * dt < MOUNTING_YAW_ENTRY_S) return false;
  EACH(k, 4) means[k] = b->sum[k] / seconds;
  number forward = (speed - b->since) / seconds, bend = MOUNTING_SIGMA_LATERAL * means[2];
  number weight = 1 / (SQUARE(MOUNTING_SIGMA_ENTRY) + means[3] + bend * bend);
  b->buffer[b->count++] =
      (Entry){course, speed * speed, {forward, means[2], means[0], means[1]}, weight};
  b->since = speed;
  EACH(k, 5) b->sum[k] = 0;
  if (b->count < MOUNTING_YAW_STRAIGHT_LENGTH) return false;
  number covered = MOUNTING_YAW_STRAIGHT_LENGTH * MOUNTING_YAW_ENTRY_S;
  number allowed = bend_variance(b, covered, MOUNTING_YAW_MAX_BEND);
  if (course_variance(b) >= least(MOUNTING_YAW_THETA_ALPHA, allowed)) {
    b->count--;
    EACH(k, b->count) b->buffer[k] = b->buffer[k + 1];
    return false;
  }
  bool updated = mounting_straight(b);
  b->count = 0;
  return updated;
}

// fusion.py; a covariance is pp, pv, pb, vv, vb, bb of one axis

static void carried(number P[6], number T, number sigma_a) { // _carried
  number pp = P[0], pv = P[1], pb = P[2], vv = P[3], vb = P[4], bb = P[5], q = T * T / 2;
  pp += T * pv - q * pb, pv += T * vv - q * vb, pb += T * vb - q * bb;
  vv -= T * vb, vb -= T * bb;
  pp += T * pv - q * pb, pv -= T * pb;
  vv -= T * vb;
  number white = sigma_a * sigma_a * T, walk = SQUARE(FUSION_SIGMA_BIAS_WALK) * T;
  P[0] = pp + white * (T * T / 3) + walk * (q * q / 5);
  P[1] = pv + white * (T / 2) + walk * (T * q / 4);
  P[2] = pb - walk * (q / 3);
  P[3] = vv + white + walk * (T * T / 3);
  P[4] = vb - walk * (T / 2);
  P[5] = bb + walk;
}

static void fusion_carry(Fusion *b) {
  if (!(b->waiting_s > 0)) return;
  carried(b->level, b->waiting_s, b->sigma_a);
  carried(b->height, b->waiting_s, b->sigma_a);
  b->waiting_s = 0;
}

static void fusion_start(Fusion *b, const number p[3], const number v[2], number sigma_p,
                         number sigma_v) {
  *b = (Fusion){.started = true, .velocity = {v[0], v[1], 0}};
  copy(b->position, p);
  b->level[0] = b->height[0] = sigma_p * sigma_p;
  b->level[3] = b->height[3] = sigma_v * sigma_v;
  b->level[5] = b->height[5] = SQUARE(FUSION_SIGMA_BIAS_START);
}

static number fusion_sigma_p(Fusion *b) {
  fusion_carry(b);
  return root(b->level[0]);
}

static void fusion_predict(Fusion *b, const number accel_n[3], number dt, number sigma_a) {
  EACH(i, 3) {
    number before = b->velocity[i], now = before + (accel_n[i] - b->bias[i]) * dt;
    b->position[i] += (before + now) * (R(0.5) * dt);
    b->velocity[i] = now;
  }
  if (sigma_a != b->sigma_a) {
    fusion_carry(b);
    b->sigma_a = sigma_a;
  }
  b->waiting_s += dt;
}

// Take in the position (state 0) or the velocity (1) of axes that share P (Fusion._measure).
static void fusion_measure(Fusion *b, const number *z, int state, number P[6], int first, int end,
                           number sigma) {
  number pp = P[0], pv = P[1], pb = P[2], vv = P[3], vb = P[4], bb = P[5];
  number p = state ? pv : pp, v = state ? vv : pv, o = state ? vb : pb;
  number gain = 1 / ((state ? v : p) + sigma * sigma);
  for (int i = first; i < end; i++) {
    number off = gain * (z[i] - (state ? b->velocity[i] : b->position[i]));
    b->position[i] += p * off, b->velocity[i] += v * off, b->bias[i] += o * off;
  }
  number gp = gain * p, gv = gain * v, go = gain * o;
  P[0] = pp - gp * p, P[1] = pv - gp * v, P[2] = pb - gp * o;
  P[3] = vv - gv * v, P[4] = vb - gv * o, P[5] = bb - go * o;
}

static void fusion_update(Fusion *b, const number *position, const number *velocity, number sigma_p,
                          number sigma_v) {
  fusion_carry(b);
  if (position) {
    fusion_measure(b, position, 0, b->level, 0, 2, sigma_p);
    fusion_measure(b, position, 0, b->height, 2, 3, sigma_p);
  }
  if (velocity) fusion_measure(b, velocity, 1, b->level, 0, 2, sigma_v);
}

// constrained.py

typedef struct {
  int state;
  number coefficient;
} Term;

static void car_wait(Constrained *b) { b->seconds = 0, zero(b->force), zero(b->turned); }

static void car_start(Constrained *b, const number position[3], const number velocity[2],
                      const Attitude *attitude, const number down[3], number mount, number sigma_p,
                      number sigma_v) {
  static const number start[] = CONSTRAINED_START;
  *b = (Constrained){.started = true, .velocity = {velocity[0], velocity[1], 0}};
  b->position[0] = position[0], b->position[1] = position[1];
  attitude_C_nb(attitude, b->C_nb);
  north_of(b->C_vb[0], down, mount);
  cross(b->C_vb[1], down, b->C_vb[0]);
  copy(b->C_vb[2], down);
  copy(b->gyro_bias, attitude->bias.x);
  number doubt = attitude->bias.P[0][0];
  EACH(i, 3) doubt = most(doubt, attitude->bias.P[i][i]);
  number tilt = most(start[0], root(attitude->tilt.p)), gyro = most(start[2], root(doubt));
  number sigmas[STATES] = {sigma_p, sigma_p, sigma_v, sigma_v, 1, tilt, tilt, start[1], gyro, gyro,
                           gyro, start[3], start[3], start[3], start[4], start[5]};
  EACH(i, STATES) b->P[i][i] = sigmas[i] * sigmas[i];
}

static void car_take(Constrained *b, const Term *terms, int n, number residual, number variance) {
  number Ph[STATES];
  EACH(i, STATES) {
    Ph[i] = 0;
    EACH(k, n) Ph[i] += terms[k].coefficient * b->P[i][terms[k].state];
  }
  EACH(k, n) {
    variance += terms[k].coefficient * Ph[terms[k].state];
    residual -= terms[k].coefficient * b->error[terms[k].state];
  }
  number gain = 1 / variance;
  EACH(i, STATES) {
    number g = gain * Ph[i];
    b->error[i] += g * residual;
    for (int j = i; j < STATES; j++) {
      b->P[i][j] -= g * Ph[j];
      b->P[j][i] = b->P[i][j];
    }
  }
}

static void car_take_one(Constrained *b, int state, number residual, number sigma) {
  car_take(b, &(Term){state, 1}, 1, residual, sigma * sigma);
}

static void turn(number C[3][3], number a, number b, number c) { // turned
  number x[3], z[3];
  EACH(k, 3) {
    x[k] = C[0][k] - c * C[1][k] + b * C[2][k];
    z[k] = C[2][k] - b * C[0][k] + a * C[1][k];
  }
  unit(z);
  number along = dot(x, z);
  EACH(k, 3) x[k] -= along * z[k];
  unit(x);
  copy(C[0], x);
  cross(C[1], z, x);
  copy(C[2], z);
}

static void car_apply(Constrained *b) {
  number *e = b->error;
  EACH(i, 2) b->position[i] += e[PLACE + i];
  add(b->velocity, e + SPEED);
  add(b->gyro_bias, e + GYRO);
  add(b->accel_bias, e + ACCEL);
  turn(b->C_nb, e[TILT], e[TILT + 1], e[TILT + 2]);
  turn(b->C_vb, 0, e[MOUNT], e[MOUNT + 1]);
  EACH(i, STATES) e[i] = 0;
}

// Row i of F but for the one on its diagonal; how many terms there are (Constrained._transition).
static int car_row(const Constrained *b, int i, Term terms[5]) {
  number T = b->seconds;
  const number *s = b->force;
  if (i < SPEED) {
    terms[0] = (Term){SPEED + i, T};
    return 1;
  }
  int axis = i < TILT ? i - SPEED : i - TILT, n = 0;
  if (i < TILT) { // the force felt, turned by an error of the attitude
    int next = (axis + 1) % 3, other = (axis + 2) % 3;
    terms[n++] = (Term){TILT + next, s[other]};
    terms[n++] = (Term){TILT + other, -s[next]};
  }
  EACH(k, 3) terms[n++] = (Term){(i < TILT ? ACCEL : GYRO) + k, -T * b->C_nb[axis][k]};
  return n;
}

static void car_carry(Constrained *b) {
  number T = b->seconds;
  if (!(T > 0)) return;
  Term terms[5];
  EACH(i, GYRO) { // F P: a row only needs rows that come later
    int n = car_row(b, i, terms);
    EACH(m, n) EACH(k, STATES) b->P[i][k] += terms[m].coefficient * b->P[terms[m].state][k];
  }
  EACH(i, GYRO) { // (F P) F'
    int n = car_row(b, i, terms);
    EACH(m, n) EACH(k, STATES) b->P[k][i] += terms[m].coefficient * b->P[k][terms[m].state];
  }
  number rate = 2 * root(dot(b->turned, b->turned)) / T;
  b->slide = CONSTRAINED_SIGMA_SIDE + CONSTRAINED_SIDE_ARM * rate;
  rate *= CONSTRAINED_RATE_SHARE;
  number turning = SQUARE(CONSTRAINED_RATE_WHITE) + rate * rate * CONSTRAINED_RATE_S;
  EACH(i, 3) {
    b->P[SPEED + i][SPEED + i] += SQUARE(CONSTRAINED_SIGMA_FORCE) * T;
    b->P[TILT + i][TILT + i] += turning * T;
    b->P[GYRO + i][GYRO + i] += SQUARE(CONSTRAINED_GYRO_WALK) * T;
    b->P[ACCEL + i][ACCEL + i] += SQUARE(CONSTRAINED_ACCEL_WALK) * T;
  }
  EACH(i, 2) b->P[MOUNT + i][MOUNT + i] += SQUARE(CONSTRAINED_MOUNT_WALK) * T;
  car_wait(b);
}

static void car_constrain(Constrained *b, bool is_static) {
  number *v = b->velocity, ahead[3], across[3], tilt[3];
  if (is_static) {
    EACH(i, 3) car_take_one(b, SPEED + i, -v[i], CONSTRAINED_SIGMA_REST);
    car_apply(b);
    return;
  }
  EACH(i, 3) ahead[i] = dot(b->C_nb[i], b->C_vb[0]);
  number along = dot(ahead, v);
  EACH(down, 2) { // to the right, then downward
    EACH(i, 3) across[i] = dot(b->C_nb[i], b->C_vb[1 + down]);
    cross(tilt, across, v);
    Term terms[7];
    EACH(i, 3) {
      terms[i] = (Term){SPEED + i, across[i]};
      terms[3 + i] = (Term){TILT + i, tilt[i]};
    }
    terms[6] = down ? (Term){MOUNT, -along} : (Term){MOUNT + 1, along};
    car_take(b, terms, 7, -dot(across, v), b->slide * b->slide);
  }
  car_take_one(b, SPEED + 2, -v[2], CONSTRAINED_SIGMA_CLIMB);
  car_apply(b);
}

static void car_reach(Constrained *b, number later) {
  number more = later - b->later;
  EACH(i, 2) b->position[i] += more * (b->velocity[i] + R(0.5) * more * b->pull[i]);
  EACH(i, 3) b->velocity[i] += more * b->pull[i];
  b->later = later;
}

static bool car_may_rest(const Constrained *b, number pull) {
  bool slow = SQUARE(b->velocity[0]) + SQUARE(b->velocity[1]) < SQUARE(CONSTRAINED_CREEP);
  return slow && SQUARE(b->pull[0]) + SQUARE(b->pull[1]) < SQUARE(pull);
}

static void car_sample(Constrained *b, const number gyro[3], const number accel[3], number dt,
                       bool is_static) {
  number half = R(0.5) * dt, a[3], f[3];
  EACH(k, 3) a[k] = half * (gyro[k] - b->gyro_bias[k]), f[k] = accel[k] - b->accel_bias[k];
  EACH(i, 3) {
    cayley(b->C_nb[i], a);
    b->pull[i] = dot(b->C_nb[i], f);
    b->force[i] += dt * b->pull[i];
  }
  b->pull[2] += GRAVITY;
  car_reach(b, dt);
  b->later = 0;
  add(b->turned, a);
  b->seconds += dt;
  if (b->seconds + R(0.5) * dt >= (b->due > 0 ? b->due : CONSTRAINED_STEP_S)) {
    car_carry(b);
    car_constrain(b, is_static);
    b->due = 0;
  }
}

static void car_update(Constrained *b, const number *position, const number *velocity,
                       number sigma_p, number sigma_v) {
  b->due = b->due > 0 ? b->due - b->seconds : CONSTRAINED_STEP_S;
  car_carry(b);
  if (position) EACH(i, 2) car_take_one(b, PLACE + i, position[i] - b->position[i], sigma_p);
  if (velocity) EACH(i, 2) car_take_one(b, SPEED + i, velocity[i] - b->velocity[i], sigma_v);
  car_apply(b);
}

// device.py

// The filter for cars once it has started, else NULL; without it in the options, never.
static Constrained *car_of(const Device *d) {
  return OPTIONS_FILTER_CAR && d->constrained && d->constrained->started ? d->constrained : NULL;
}

void device_start(Device *d, const Stored *stored, bool has_imu, Constrained *constrained) {
  *d = (Device){.before = NONE, .t_before = -INFINITY, .squares = {NONE, NONE}};
  d->unaided = R(0.25) * SQUARE(OPTIONS_SIGMA_UNAIDED);
  d->t_imu = d->t_fusion = d->t_epoch = NAN, d->t_fix = -INFINITY;
  if (!OPTIONS_LAST_POSITION || !stored || !stored->known) stored = NULL;
  last_start(&d->last, stored);
  if (stored) frame_start(&d->frame, &stored->at), d->has_ned = true;
  d->has_attitude = OPTIONS_ATTITUDE && has_imu;
  attitude_start(&d->attitude);
  d->still = (StaticTest){true, UNKNOWN, UNKNOWN, UNKNOWN, {0}, AT_REST_EVERY_S, 0, 0, 0, 0};
  rest_reset(&d->rest);
  mounting_start(&d->mounting);
  d->fuses = OPTIONS_FUSION && (OPTIONS_FILTER_BLOCK6 || OPTIONS_FILTER_CAR) && d->has_attitude;
  d->last.bridged_s = d->fuses ? OPTIONS_BRIDGE_S : DEVICE_COASTS;
  d->constrained = OPTIONS_FILTER_CAR && d->fuses ? constrained : NULL;
  if (d->constrained) d->constrained->started = false;
}

static wide device_now(Device *d, wide t_s, wide before) {
  if (!((wide)-INFINITY < t_s && t_s < (wide)INFINITY)) return NAN;
  if (is_time(before) && t_s + d->shift < before - (wide)DEVICE_GAP_S) {
    wide last = is_time(d->t_imu) ? d->t_imu : d->t_epoch;
    d->shift = latest(last, d->t_epoch) + 2 * (wide)DEVICE_GAP_S - t_s;
  }
  return t_s + d->shift;
}

// A step of time to a nanosecond, as Python rounds it; a float holds no more than the difference.
static number step_of(wide now, wide before) {
  wide dt = now - before;
  return sizeof(number) == sizeof(float) ? R(dt) : R(rint((double)dt * 1e9) / 1e9);
}

static bool possible(const number v[3], number bound) { // _possible
  EACH(k, 3) if (!(-bound < v[k] && v[k] < bound)) return false;
  return true;
}

static Epoch device_known(const Device *d, const Epoch *given, wide t_s) { // after _now
  Epoch e = *given;
  wide before = d->t_epoch;
  if (!is_time(before)) before = is_time(t_s) ? t_s : is_time(d->t_imu) ? d->t_imu : 0;
  e.t_s = latest(before, t_s);
  Place *p = &e.fix;
  if (!(-DEVICE_HEIGHT < p->height_m && p->height_m < DEVICE_HEIGHT)) p->height_m = NONE;
  bool lat = -90 <= p->lat_deg && p->lat_deg <= 90, lon = -360 <= p->lon_deg && p->lon_deg <= 360;
  e.has_fix = e.has_fix && lat && lon;
  if (!(0 <= e.pdop && e.pdop < R(INFINITY))) e.pdop = NONE;
  if (!(0 <= e.speed && e.speed < DEVICE_SPEED)) e.speed = NONE;
  if (!(R(-INFINITY) < e.course && e.course < R(INFINITY))) e.course = NONE;
  return e;
}

static bool device_sighted(const Device *d) {
  bool mounted = known(d->mounting.mount) || !OPTIONS_MOUNTING;
  return d->attitude.ready && d->attitude.heading_known && mounted;
}

static bool device_without_imu(const Device *d, wide t_s) {
  return is_time(d->t_imu) && t_s - d->t_imu > (wide)DEVICE_GAP_S;
}

static void device_predict(Device *d, wide t_s) {
  number dt = step_of(t_s, d->t_fusion), accel_n[3] = {0};
  if (!(dt > 0)) return;
  d->t_fusion = t_s;
  bool aided = device_sighted(d) && !device_without_imu(d, t_s);
  if (aided) attitude_accel_n(&d->attitude, accel_n);
  fusion_predict(&d->fusion, accel_n, dt, aided ? OPTIONS_SIGMA_ACCEL : OPTIONS_SIGMA_UNAIDED);
}

void device_imu(Device *d, wide t_s, const number gyro_b[3], const number accel_b[3]) {
  wide before = d->t_imu;
  t_s = device_now(d, t_s, before);
  number dt = is_time(before) ? step_of(t_s, before) : 0;
  bool late = is_time(before) ? !(dt > 0) : !is_time(t_s);
  if (late || !possible(gyro_b, DEVICE_RATE) || !possible(accel_b, DEVICE_FORCE)) return;
  d->t_imu = t_s;
  if (!d->has_attitude) return;
  Attitude *block = &d->attitude;
  if (REST_DETECTOR_REST_BLOCKS) {
    bool quiet = rest_sample(&d->rest, gyro_b, accel_b, dt);
    bool slow = d->pace < OPTIONS_SPEED_THRESHOLD;
    if (quiet && slow && d->still.moving)
      attitude_restart(block, d->rest.force, d->rest.rate);
    d->still.quiet = d->rest.steady ? YES : NO;
  }
  number mean[3];
  EACH(k, 3) mean[k] = R(0.5) * (gyro_b[k] + block->last[k]);
  attitude_imu(block, gyro_b, accel_b, dt, !d->still.moving);
  Constrained *car = car_of(d);
  if (car && dt > DEVICE_GAP_S) car->started = false;
  if (!block->ready) return;
  number ax, ay;
  level(block->external, block->tilt.x, &ax, &ay); // Attitude.horizontal
  bool moved = static_accelerate(&d->still, ax, ay, dt);
  d->moved = d->moved || moved;
  if (!d->last.accepted) {
    d->rested = d->rested || !moved;
    if (moved && d->rested && d->last.position.known) {
      last_motion(&d->last);
      d->has_ned = false;
    }
  }
  add(d->sum, accel_b);
  d->sum[3] += dot(accel_b, accel_b);
  d->samples++;
  if (d->fuses && d->fusion.started) device_predict(d, t_s);
  if (car && car->started) {
    bool lost = t_s - d->t_fix > (wide)DEVICE_GAP_S;
    bool rests = lost && d->rest.steady && car_may_rest(car, CONSTRAINED_PULL);
    car_sample(car, mean, accel_b, dt, rests || !d->still.moving);
  }
}

static bool device_rests(Device *d, number speed, number dt) {
  if (known(speed)) d->pace = speed;
  bool now = static_drive(&d->still, speed, dt), moved = now || d->moved;
  d->moved = false;
  return !moved;
}

// NULL where there is no fix.
static number device_by_fixes(Device *d, wide t_s, const number *fix, number speed, number course) {
  if (fix && d->held < DEVICE_HELD)
    d->fixes[d->held++] = (Fix){t_s, {fix[0], fix[1], fix[2]}, speed, course};
  while (d->held && t_s - d->fixes[0].t_s > (wide)DEVICE_FIXES_S)
    for (int k = 0, left = --d->held; k < left; k++) d->fixes[k] = d->fixes[k + 1];
  if (!d->held) return NONE;
  const Fix *was = d->fixes, *now = &d->fixes[d->held - 1];
  wide seconds = now->t_s - was->t_s;
  if (seconds < (wide)(DEVICE_FIXES_S / 2)) return NONE;
  number T = R(seconds), north = now->fix[0] - was->fix[0], east = now->fix[1] - was->fix[1];
  number metres = was->speed * T;
  if (fix && metres > DEVICE_FIXES_S && known(was->course)) {
    number north_off = north - metres * cosine(was->course);
    number east_off = east - metres * sine(was->course);
    number found = R(0.5) * (SQUARE(north_off) + SQUARE(east_off)) / SQUARE(T * T);
    d->unaided += (found - d->unaided) / DEVICE_LEARNT;
  }
  return norm(north, east) / T;
}

static number device_vehicle(Device *d, wide t_s, number speed, number yaw_rate) {
  wide seconds = t_s - d->t_before;
  if (seconds > (wide)DEVICE_GAP_S || (seconds > 0 && known(yaw_rate))) {
    d->squares[0] = d->squares[1];
    d->squares[1] = SQUARE((speed - d->before) / R(seconds)) + SQUARE(speed * yaw_rate);
    d->t_before = t_s, d->before = speed;
  }
  return known(d->squares[0] + d->squares[1]) ? most(d->squares[0], d->squares[1]) : NONE;
}

static void device_orient(Device *d, wide t_s, bool moving, bool rests, number course,
                          number speed, number dt) {
  Attitude *block = &d->attitude;
  if (!d->has_attitude) return;
  number force[3], heading = NONE, sigma = NONE, ax, ay, count = R(d->samples);
  bool driving = moving && speed >= OPTIONS_MIN_SPEED && known(course);
  number between = d->apart + dt;
  d->apart = d->samples || device_without_imu(d, t_s) ? 0 : between;
  if (!moving) {
    mounting_interrupt(&d->mounting);
  } else if (d->samples) {
    EACH(k, 3) force[k] = d->sum[k] / count;
    number variance = most(d->sum[3] / count - dot(force, force), 0) / (3 * count);
    if (!d->upright.known) {
      number up[3];
      EACH(k, 3) up[k] = -GRAVITY * block->tilt.x[k];
      upright_start(&d->upright, up);
    }
    if (driving) upright_step(&d->upright, force, between);
    number down[3], rate = attitude_yaw_rate(block);
    opposite(down, d->upright.mean);
    level(force, down, &ax, &ay); // Upright.level
    if (OPTIONS_MOUNTING &&
        mounting_step(&d->mounting, between, course, speed, rate, ax, ay, variance))
      block->heading_known = false;
  }
  zero(d->sum);
  d->sum[3] = 0, d->samples = 0;
  if (driving) {
    heading = wrap(course + or_zero(d->mounting.mount));
    sigma = most(OPTIONS_SIGMA_SPEED / speed, R(PI / 180));
  }
  number vehicle = device_vehicle(d, t_s, speed, attitude_yaw_rate(block));
  attitude_epoch(block, rests, heading, sigma, vehicle);
}

static void device_ellipse(Device *d, wide t_s, bool moving, number out[3]) {
  bool filters = d->fuses && d->fusion.started;
  out[0] = out[1] = out[2] = NONE;
  if (!d->has_left) return;
  number T = moving && !(filters && device_sighted(d)) ? R(t_s - d->t_fix) : 0;
  number straight = least(T, DEVICE_COASTS);
  number a = OPTIONS_SIGMA_SPEED * straight, b = d->pace * (T - straight);
  number square = a * a + b * b + d->unaided * SQUARE(straight * straight);
  if (filters) square = most(square, SQUARE(fusion_sigma_p(&d->fusion)));
  const Constrained *car = car_of(d);
  out[0] = (car ? car->P[0][0] : square) + d->lasting;
  out[1] = car ? car->P[0][1] : 0;
  out[2] = (car ? car->P[1][1] : square) + d->lasting;
}

static bool device_contradicted(Device *d, const number fix[3], number sigma) {
  number ellipse[3];
  device_ellipse(d, d->t_fix, true, ellipse);
  number square = SQUARE(fix[0] - d->ned[0]) + SQUARE(fix[1] - d->ned[1]);
  number wide_of = most(ellipse[0], ellipse[2]) + sigma * sigma;
  return square > most(SQUARE(LOW_PASS_JUMP_M), SQUARE(DEVICE_FAR) * wide_of);
}

static Constrained *device_constrain(Device *d, const number *fix, const number *velocity,
                                     number sigma_p, number sigma_v) {
  Constrained *car = car_of(d);
  bool without = device_without_imu(d, d->t_epoch);
  if (car && without) car->started = false;
  if (!OPTIONS_FILTER_CAR || !d->constrained || !d->attitude.ready || without) return NULL;
  number later = most(0, (number)(d->t_epoch - d->t_imu));
  if (car) {
    car_reach(car, later);
    car_update(car, fix, velocity, sigma_p, sigma_v);
  } else if (device_sighted(d) && fix && velocity && d->pace > DEVICE_FAST) {
    number down[3], mount = or_zero(d->mounting.mount);
    opposite(down, d->upright.mean);
    car_start(d->constrained, fix, velocity, &d->attitude, down, mount, sigma_p, sigma_v);
    d->constrained->later = later;
  }
  return car_of(d);
}

static void device_coast(Device *d, wide seconds) {
  if (seconds > (wide)DEVICE_COASTS || !d->has_left) return;
  const Fix *left = &d->left;
  if (!known(left->speed) || !known(left->course)) return;
  number metres = left->speed * R(seconds);
  d->ned[0] = left->fix[0] + metres * cosine(left->course);
  d->ned[1] = left->fix[1] + metres * sine(left->course);
  d->ned[2] = left->fix[2], d->has_ned = true;
}

// Returns whether there is a velocity.
static bool device_quality(const Device *d, const Epoch *e, bool accepted, bool moving,
                           number *sigma_p, number *sigma_v, number velocity[2]) {
  bool graded = accepted && known(e->pdop);
  *sigma_p = graded ? most(1, OPTIONS_METRES_PER_PDOP * e->pdop) : OPTIONS_SIGMA_NO_PDOP;
  if (accepted && d->last.doubted) *sigma_p = DEVICE_SIGMA_DOUBTED;
  *sigma_v = moving ? OPTIONS_SIGMA_SPEED : OPTIONS_SIGMA_REST_M_S;
  velocity[0] = velocity[1] = 0;
  if (!moving) return true;
  if (!accepted || !known(e->speed)) return false;
  if (!known(e->course)) {
    *sigma_v = most(OPTIONS_SIGMA_SPEED, e->speed);
    return e->speed < OPTIONS_MIN_SPEED;
  }
  velocity[0] = e->speed * cosine(e->course), velocity[1] = e->speed * sine(e->course);
  return true;
}

static void device_put_out(Device *d, const number ned[3]) {
  copy(d->ned, ned);
  d->has_ned = true;
}

static void device_fuse(Device *d, const Epoch *e, const number *fix, bool moving, int layer) {
  const number *rest = d->low_pass.position;
  Fusion *block = &d->fusion;
  number sigma_p, sigma_v, at[2];
  const number *velocity = device_quality(d, e, fix, moving, &sigma_p, &sigma_v, at) ? at : NULL;
  if (fix && d->last.jumped && block->started && device_contradicted(d, fix, sigma_p)) {
    block->started = false;
    if (d->constrained) d->constrained->started = false;
  }
  if (fix) d->lasting = sigma_p * sigma_p;
  if (!d->fuses || !(block->started || fix)) {
    if (layer) device_put_out(d, rest);
    else if (fix) device_put_out(d, fix);
    else if (moving) device_coast(d, e->t_s - d->t_fix);
    return;
  }
  if (!block->started) {
    fusion_start(block, fix, at, sigma_p, 1);
    d->t_fusion = e->t_s;
  } else {
    static const number none[2] = {0, 0};
    device_predict(d, e->t_s);
    if (layer) fusion_update(block, rest, none, OPTIONS_SIGMA_REST_M, sigma_v);
    else if (fix || velocity) fusion_update(block, fix, velocity, sigma_p, sigma_v);
  }
  if (moving) sigma_v = most(sigma_v, root(d->last.slip));
  const Constrained *car = device_constrain(d, fix, velocity, sigma_p, sigma_v);
  if (layer) {
    device_put_out(d, rest);
  } else if (e->t_s - d->t_fix <= (wide)OPTIONS_BRIDGE_S) {
    device_put_out(d, block->position);
    if (car) d->ned[0] = car->position[0], d->ned[1] = car->position[1];
  }
}

Row device_gnss(Device *d, const Epoch *given) {
  Epoch epoch = device_known(d, given, device_now(d, given->t_s, d->t_epoch)), *e = &epoch;
  wide apart = is_time(d->t_epoch) ? e->t_s - d->t_epoch : 0;
  d->t_epoch = e->t_s;
  bool first = !d->last.accepted, accepted = last_step(&d->last, e);
  if (accepted && first) frame_start(&d->frame, &e->fix);
  if (!d->last.position.known) d->has_ned = false;
  number ned[3], *fix = accepted ? ned : NULL;
  if (accepted) frame_ned(&d->frame, &e->fix, ned);
  number speed = accepted ? e->speed : NONE, course = accepted ? e->course : NONE;
  d->gives_speed = d->gives_speed || known(e->speed);
  bool no_imu = device_without_imu(d, e->t_s);
  if (no_imu) static_no_imu(&d->still);
  wide last = d->held ? d->fixes[d->held - 1].t_s : (wide)-INFINITY;
  bool each = accepted && e->t_s - last + apart / 2 >= (wide)AT_REST_EVERY_S;
  number by_fixes = device_by_fixes(d, e->t_s, each ? fix : NULL, speed, course);
  number told = d->gives_speed ? speed : by_fixes;
  const Constrained *car = car_of(d);
  if (!known(told) && car && !car_may_rest(car, R(INFINITY))) told = CONSTRAINED_CREEP;
  bool rests = device_rests(d, told, R(apart));
  bool moving = !(rests && OPTIONS_STATIC);
  device_orient(d, e->t_s, moving, rests, course, speed, R(apart));
  wide silent = d->has_attitude ? apart : e->t_s - d->t_fix;
  if (moving || !OPTIONS_LOW_PASS || silent > (wide)LOW_PASS_GAP_S) low_pass_reset(&d->low_pass);
  if (accepted) {
    d->t_fix = e->t_s;
    d->left = (Fix){e->t_s, {ned[0], ned[1], ned[2]}, speed, course}, d->has_left = true;
    if (each && !moving && OPTIONS_LOW_PASS) low_pass_step(&d->low_pass, ned);
  }
  int layer = d->low_pass.layer;
  device_fuse(d, e, fix, moving, layer);
  Row row = {accepted, moving, layer, NAN, NAN, NONE, NONE, NONE, d->mounting.mount,
             {NONE, NONE, NONE}};
  car = car_of(d);
  if (d->has_attitude && !no_imu) {
    if (car) {
      number C[3][3];
      EACH(i, 3) copy(C[i], car->C_nb[i]);
      angles_of(C, &row);
    } else {
      attitude_angles(&d->attitude, &row);
    }
    if (!device_sighted(d)) row.yaw = NONE;
  }
  if (d->has_ned) { // Frame.degrees
    row.lat_deg = d->frame.origin.lat_deg + (wide)(d->ned[0] / d->frame.north);
    row.lon_deg = turned_back(d->frame.origin.lon_deg + (wide)(d->ned[1] / d->frame.east));
  }
  device_ellipse(d, e->t_s, moving, row.ellipse);
  return row;
}
