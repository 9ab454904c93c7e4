/* An axis with Switch friction, by Dormand and Prince's pair of order 5 with events; made by axis_motion.py.

   J x1'' = m - F - k (x1 - phi) - d (x1' - phi'),   JL phi'' = k (x1 - phi) + d (x1' - phi')
   e = x1 or phi;   u = -(kp e + kd r + ki x3),   r = e' or (e - f)/Tf with Tf f' = e - f
   c = u,   or c' = w (u - c) (low-pass),   or c = u - 2 z w (1 - depth) q with p' = q, q' = u - w^2 p - 2 z w q (notch)
   m = c, or at its limit +-M;   x3' = e - leak x3; at the limit that, 0, or e + (c - m)/(ki Tu)
   F = s Fc + s (Fs - Fc) exp(-(x1'/vs)^2) + b x1' of the direction s; stuck while -Fs_back <= pull <= Fs

   built() runs it by a drive, from sample to sample.

   A step ends where a scalar has crossed zero: its length is bisected, the step taken anew, to the last digit. */
#include <math.h>
#include <string.h>
enum { X, V, I, PHI, W, LAG, P, Q, N };
typedef struct {
    double J, JL, k, d, seen, kp, kd, ki, Tf, kind, w, z, depth, M, way, Tu, Fs[2], Fc[2], b[2], vs, longest_step, leak;
} Axis;
typedef struct { int sign, at; } Mode;

static double demand(const Axis *a, const double *y) {
    double e = a->seen ? y[PHI] : y[X], rate = a->seen ? y[W] : y[V];
    return -(a->kp * e + a->kd * (a->Tf > 0 ? (e - y[LAG]) / a->Tf : rate) + a->ki * y[I]);
}
static double command(const Axis *a, const double *y) {
    if (a->kind == 3) return a->w; /* held by a drive */
    if (a->kind == 1) return y[P];
    return demand(a, y) - (a->kind == 2 ? 2 * a->z * a->w * (1 - a->depth) * y[Q] : 0);
}
static double shaft(const Axis *a, const double *y) { return a->k * (y[X] - y[PHI]) + a->d * (y[V] - y[W]); }
static double pull(const Axis *a, const double *y, int at) { return (at ? at * a->M : command(a, y)) - shaft(a, y); }

static void rates(const Axis *a, Mode now, const double *y, double *f) {
    double e = a->seen ? y[PHI] : y[X], c = command(a, y), u = demand(a, y), v = y[V];
    memset(f, 0, N * sizeof *f);
    if (now.sign) {
        int o = now.sign < 0;
        double g = a->Fc[o] + (a->Fs[o] - a->Fc[o]) * exp(-(v / a->vs) * (v / a->vs));
        f[X] = v;
        f[V] = (pull(a, y, now.at) - now.sign * g - a->b[o] * v) / a->J;
    }
    f[I] = e - a->leak * y[I];
    if (now.at && a->way == 1) f[I] = 0;
    if (now.at && a->way == 2) f[I] = e + (c - now.at * a->M) / (a->ki * a->Tu);
    if (a->JL > 0) { f[PHI] = y[W]; f[W] = shaft(a, y) / a->JL; }
    if (a->Tf > 0) f[LAG] = (e - y[LAG]) / a->Tf;
    if (a->kind == 1) f[P] = a->w * (u - y[P]);
    if (a->kind == 2) { f[P] = y[Q]; f[Q] = u - a->w * a->w * y[P] - 2 * a->z * a->w * y[Q]; }
}

/* One step: y1; the error, in parts of what is allowed. */
static double step(const Axis *a, Mode now, const double *y, double h, const double *allowed, double *y1) {
    static const double A[7][6] = {{0}, {1. / 5}, {3. / 40, 9. / 40}, {44. / 45, -56. / 15, 32. / 9},
        {19372. / 6561, -25360. / 2187, 64448. / 6561, -212. / 729},
        {9017. / 3168, -355. / 33, 46732. / 5247, 49. / 176, -5103. / 18656},
        {35. / 384, 0, 500. / 1113, 125. / 192, -2187. / 6784, 11. / 84}};
    static const double E[7] = {71. / 57600, 0, -71. / 16695, 71. / 1920, -17253. / 339200, 22. / 525, -1. / 40};
    double f[7][N], worst = 0;
    for (int i = 0; i < 7; i++) {
        for (int n = 0; n < N; n++) {
            double sum = 0;
            for (int j = 0; j < i; j++) sum += A[i][j] * f[j][n];
            y1[n] = y[n] + h * sum;
        }
        rates(a, now, y1, f[i]);
    }
    for (int n = 0; n < N; n++) {
        double off = 0;
        for (int i = 0; i < 7; i++) off += E[i] * f[i][n];
        worst = fmax(worst, fabs(h * off) / allowed[n]);
    }
    return worst;
}

/* Scalars that are below zero until their event: stop or both breakaways, limits or the way back from one. */
static int edges(const Axis *a, Mode now, const double *y, double *g) {
    double c = command(a, y), pulled = pull(a, y, now.at);
    g[0] = now.sign ? -now.sign * y[V] : pulled - a->Fs[0];
    g[1] = now.sign ? -1 : -a->Fs[1] - pulled;
    g[2] = now.at ? a->M - now.at * c : c - a->M;
    g[3] = now.at ? -1 : -a->M - c;
    for (int i = 0; i < 4; i++) if (g[i] > 0 || (i == 0 && now.sign && g[0] == 0)) return i;
    return -1;
}
static int sign_at_rest(const Axis *a, const double *y, int at) {
    double pulled = pull(a, y, at);
    return pulled > a->Fs[0] ? 1 : pulled < -a->Fs[1] ? -1 : 0;
}

/* The motion of y, whose mode is sign and at (sign 2: told by y), up to `most` stops; each stop's time and state into
   stops.  Returns how many; *t is the time at the end, *phases those that are allowed and left. */
int motion(const Axis *a, double *y, int *sign, int *at, double *t, double longest, double tol, double *size,
           double gone, int most, long *phases, double *stops) {
    Mode now = {*sign, *at};
    int many = 0;
    double h = 1e-6 * a->longest_step, y1[N], g[4], allowed[N], last = y[X];
    if (now.sign == 2) {
        now.at = command(a, y) > a->M ? 1 : command(a, y) < -a->M ? -1 : 0;
        now.sign = y[V] > 0 ? 1 : y[V] < 0 ? -1 : sign_at_rest(a, y, now.at);
    }
    while (many < most && *t < longest && *phases > 0) {
        for (int n = 0; n < N; n++) {
            size[n] = fmax(size[n], fabs(y[n]));
            allowed[n] = tol * size[n] + 1e-300;
        }
        double off = step(a, now, y, h, allowed, y1);
        if (!(off <= 1)) { h *= fmax(0.2, 0.9 * pow(off, -0.2)); if (!(h > 0)) return -1; continue; }
        int met = edges(a, now, y1, g);
        if (met < 0) {
            memcpy(y, y1, sizeof y1);
            *t += h;
            h = fmin(fmin(h * fmin(4, 0.9 * pow(off + 1e-10, -0.2)), a->longest_step), longest - *t + 1e-12);
            continue;
        }
        double low = 0, high = h;
        for (int i = 0; i < 60 && high - low > 0; i++) {
            double middle = (low + high) / 2;
            if (middle == low || middle == high) break;
            step(a, now, y, middle, allowed, y1);
            if (edges(a, now, y1, g) < 0) low = middle; else high = middle;
        }
        step(a, now, y, high, allowed, y1);
        met = edges(a, now, y1, g);
        if (met < 0) met = 0;
        memcpy(y, y1, sizeof y1);
        *t += high;
        h = 1e-6 * a->longest_step;
        --*phases;
        if (met >= 2) now.at = now.at ? 0 : met == 2 ? 1 : -1;
        else if (!now.sign) now.sign = met == 0 ? 1 : -1;
        else {
            y[V] = 0;
            now.sign = sign_at_rest(a, y, now.at);
            stops[many * (N + 1)] = *t;
            memcpy(stops + many * (N + 1) + 1, y, N * sizeof *y);
            many++;
            if (fabs(y[X] - last) < gone && fabs(y[X]) < gone) break;
            last = y[X];
        }
    }
    *sign = now.sign;
    *at = now.at;
    return many;
}

/* As built: every T a drive reads e = q floor((theta_d + x + noise)/q + 1/2) - theta_d and holds its torque from `late` samples
   and `part` seconds later on; backward differences, the sum by rectangles of the present reading, a torque limit
   without anti-windup.  (x1, torque) of each of the samples into out; returns how many. */
long built(const Axis *a, double T, double q, double theta_d, long late, double part, double *y, long samples, double tol,
           double far, const double *noise, double *out) {
    Axis plant = *a;
    double sum = 0, lag = 0, p = 0, rate = 0, before = 0, waiting[1024] = {0}, size[N], t, scratch[64 * (N + 1)];
    int sign = 2, at = 0;
    plant.kind = 3;
    plant.Tf = 0;
    plant.M = 1e300;
    plant.way = 0;
    for (int n = 0; n < N; n++) size[n] = fabs(y[n]);
    for (long k = 0; k < samples; k++) {
        double x = (a->seen ? y[PHI] : y[X]) + noise[k], e = (q > 0 ? q * floor((theta_d + x) / q + 0.5) : theta_d + x) - theta_d;
        if (!k) before = lag = e;
        sum += T * e;
        if (a->Tf > 0) lag = (lag + T / a->Tf * e) / (1 + T / a->Tf);
        double slope = a->Tf > 0 ? (e - lag) / a->Tf : (e - before) / T, u = -(a->kp * e + a->kd * slope + a->ki * sum);
        before = e;
        if (a->kind == 1) u = p = (p + T * a->w * u) / (1 + T * a->w);
        if (a->kind == 2) {
            rate = (rate + T * u - T * a->w * a->w * p) / (1 + 2 * a->z * a->w * T + a->w * a->w * T * T);
            p += T * rate;
            u -= 2 * a->z * a->w * (1 - a->depth) * rate;
        }
        u = fmin(fmax(u, -a->M), a->M);
        out[2 * k] = y[X];
        out[2 * k + 1] = u;
        waiting[k % 1024] = u;
        for (int half = 0; half < 2; half++) {
            long which = k - late - (half ? 0 : 1);
            long phases = 1000000;
            double lasts = half ? T - part : part;
            if (!(lasts > 0)) continue;
            plant.w = which >= 0 ? waiting[which % 1024] : 0;
            for (t = 0; t < lasts * (1 - 1e-12);)
                if (motion(&plant, y, &sign, &at, &t, lasts, tol, size, 0, 64, &phases, scratch) < 0) return -1;
        }
        if (fabs(y[X]) > far) return k + 1;
    }
    return samples;
}
