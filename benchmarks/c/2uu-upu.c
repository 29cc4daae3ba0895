/* 2UU-UPU: two UU limbs, a four-bar in a plane that turns about its base, and a UPU limb; one
 * translation and two rotations. First working mode (the platform's bar above the base).
 *
 * With m = cos beta sin gamma and mu^2 = 1 - m^2 a pose leaves a curve of configurations, told by
 * u = tan(v / 2), on which P_x = x is solved: cells outwards from v = 0 are searched for the first
 * that crosses x or turns back, in which parabolas lead to the root. Poses that are done leave the
 * iteration. */
#define DIMENSION 3
#define ORDER 3
#include "sweep.h"

#define NEAR 5           /* cells up to v = 90 degrees */
#define CELLS 7          /* and in all */
#define BEYOND 2.0       /* end of the first one beyond, in u */
#define FAR 64.0         /* stands for u at v = 180 degrees */
#define POINTS 15
#define CLOSE 1e-9       /* a miss of x over L beyond it is no root */
#define CONVERGED 1e-14  /* a miss over L that is rounding */
#define LEAST 1e-20      /* of f^2 */

struct design {
    double base, platform, length, characteristic; /* sides of both triangles, links */
    double low, high;                              /* stroke of l1 */
};

/* What follows from a design. */
struct sizes {
    double a, c, l2, length, r, big_r, sign, far_cos;
};

/* Of a pose, of the search. */
enum { X, M, MU, SIN_W, COS_W, COS_B, FAR_U, SIDE, T, T1, LOW, HIGH, E1, G_LOW, G_HIGH, FIRST, LAST,
       BEFORE, SEARCHING, COLUMNS };

struct turn {
    double sphi, cphi, sk, ck, spsi, cpsi;
};

INLINE struct turn turned(double u, double m, double mu, double sw, double cw) {
    const double d = 1.0 / (1.0 + u * u), cv = (1.0 - u * u) * d, sv = 2.0 * u * d;
    const double cphi = sqrt(cv * cv + m * m * sv * sv) + TINY, over = 1.0 / cphi;
    return (struct turn){mu * sv, cphi, m * over, mu * cv * over, sw * cv - cw * sv, cw * cv + sw * sv};
}

/* f, M's height h and its derivative by kappa times |f|. */
INLINE double bar(const struct sizes *k, double sk, double ck, double *f, double *g, double *h, double *h_k) {
    const double less = sk * sk / (1.0 + fabs(ck)) + (fabs(ck) - ck), a = k->a, c = k->c;
    const double over = 1.0 / ((a - c) * (a - c) + 2.0 * a * c * less + 1e-140);
    const double excess = k->l2 * over - 1.0, arm = a - c + c * less;
    *f = k->sign * sqrt(greater(excess, LEAST));
    *g = -k->l2 * a * c * sk * over * over;
    *h = *f * arm;
    *h_k = k->sign * (*g * arm + *f * *f * c * sk);
    return excess;
}

/* The search's point j. */
INLINE void step(const struct sizes *k, column *at, int i, int j) {
    const double u = at[SIDE][i] * at[T][i], t = at[T][i];
    const struct turn q = turned(u, at[M][i], at[MU][i], at[SIN_W][i], at[COS_W][i]);
    double f, g, h, h_k;
    bar(k, q.sk, q.ck, &f, &g, &h, &h_k);
    const double half_r = 0.5 * k->big_r, big_f = k->sign * f;
    const double value = h * q.sphi + half_r * (q.cphi * q.cpsi - q.sphi * q.ck * q.spsi);
    const double even = h_k * q.sk * q.sphi * q.sphi +
                        big_f * (h * q.cphi * q.cphi * q.ck + half_r * q.spsi * q.sk * q.sk);
    const double last = even / (big_f * q.cphi), slope = last * 2.0 / (1.0 + u * u);
    const double miss = value - at[X][i];
    at[LAST][i] = last;
    if (j == 0) {
        at[FIRST][i] = last;
        at[SIDE][i] = miss < 0.0 ? 1.0 : -1.0;
    }
    const double t0 = at[T1][i], e0 = at[E1][i], e1 = at[SIDE][i] * miss;
    const int again = at[BEFORE][i] != 0.0, before = e1 < 0.0 && slope > 0.0;
    const double low = before ? t : at[LOW][i], high = before ? at[HIGH][i] : t;
    /* An end that stays has its slope halved (Illinois): the secant cannot get stuck. */
    const double g_low = before ? even : again ? at[G_LOW][i] : 0.5 * at[G_LOW][i];
    const double g_high = !before ? even : again ? 0.5 * at[G_HIGH][i] : at[G_HIGH][i];
    const int searching = at[SEARCHING][i] != 0.0 && before && j < CELLS;
    const double far = at[FAR_U][i];
    const double node = j < NEAR ? lesser(far, 1.0) * ((j + 1) * (1.0 / NEAR))
                                 : j > NEAR ? far : lesser(far, BEYOND);
    const double width = t0 - t, bend = (e0 - e1 - slope * width) / (width * width + TINY);
    const double inner = slope * slope - 4.0 * bend * e1, rise = slope + sqrt(greater(inner, 0.0));
    const double root = t - 2.0 * e1 / (fabs(rise) > TINY ? rise : TINY);
    const double turn = (low * g_high - high * g_low) / (g_high - g_low - TINY);
    double next = inner > 0.0 ? root : turn;
    next = next >= low && next <= high ? next : 0.5 * (low + high);
    at[T][i] = searching ? node : next;
    at[T1][i] = t;
    at[E1][i] = e1;
    at[LOW][i] = low;
    at[HIGH][i] = high;
    at[G_LOW][i] = g_low;
    at[G_HIGH][i] = g_high;
    at[BEFORE][i] = before ? 1.0 : 0.0;
    at[SEARCHING][i] = searching ? 1.0 : 0.0;
}

/* The least slack of a pose; its sign counts. */
INLINE double slack(const struct design *d, const struct sizes *k, column *at, int i) {
    const struct turn q = turned(at[SIDE][i] * at[T1][i], at[M][i], at[MU][i], at[SIN_W][i], at[COS_W][i]);
    double f, g, h, h_k;
    const double excess = bar(k, q.sk, q.ck, &f, &g, &h, &h_k), arm = 1.5 * k->big_r;
    const double wx = h * q.sphi + arm * (q.cphi * q.cpsi - q.sphi * q.ck * q.spsi) - 1.5 * k->r;
    const double wy = f * k->c * q.sk + arm * q.spsi * q.sk;
    const double wz = h * q.cphi + arm * (-q.sphi * q.cpsi - q.cphi * q.ck * q.spsi);
    const double l1 = sqrt(wx * wx + wy * wy + wz * wz);
    double least = lesser(lesser(at[FIRST][i], at[LAST][i]), excess);
    least = lesser(least, CLOSE * k->length - fabs(at[E1][i]));
    return lesser(least, lesser(l1 - d->low, d->high - l1));
}

/* A positive multiple of Qq adj(Xq), with the derivatives by q = (phi, kappa, psi) of the joints
 * and of the pose. */
INLINE void entries(const struct sizes *k, double weight, column *at, int i, double *e) {
    const struct turn q = turned(at[SIDE][i] * at[T1][i], at[M][i], at[MU][i], at[SIN_W][i], at[COS_W][i]);
    double f, g, h, h_k;
    bar(k, q.sk, q.ck, &f, &g, &h, &h_k);
    const double a = k->a, c = k->c, half = 0.5 * k->big_r, arm = 3.0 * half;
    const double y = f * c * q.sk, y_k = k->sign * c * (g * q.sk + f * f * q.ck), big_f = k->sign * f;
    /* Rot x, o = Rot y, n and what is needed of o x Rot x and n x Rot x */
    const double xx = q.cphi * q.cpsi - q.sphi * q.ck * q.spsi, xy = q.spsi * q.sk;
    const double xz = -q.sphi * q.cpsi - q.cphi * q.ck * q.spsi, ox = q.sphi * q.sk, oz = q.cphi * q.sk;
    const double cx = q.ck * xz - oz * xy, cz = ox * xy - q.ck * xx, nx = q.sphi * xy, nz = q.cphi * xy;
    const double wx = h * q.sphi + arm * xx - 1.5 * k->r, wz = h * q.cphi + arm * xz;
    const double flat2 = wx * wx + wz * wz;
    /* theta1's row of Qq times flat2 */
    const double t_phi = wz * wz + wx * (wx + 1.5 * k->r);
    const double t_k = (h_k * q.sphi + big_f * arm * nx) * wz - (h_k * q.cphi + big_f * arm * nz) * wx;
    const double t_psi = arm * (cx * wz - cz * wx);
    const double d3_s = y + a - c * q.ck, d3_c = h - c * q.sk;
    const double d3 = flat2 / k->l2 *
                      ((y_k + big_f * c * q.sk) * d3_c - (h_k - big_f * c * q.ck) * d3_s);
    /* Xq: rates of x, of beta times cos beta, of gamma times cos^2 beta */
    const double x_phi = h * q.cphi + half * xz, x_k = (h_k + big_f * half * xy) * q.sphi, x_psi = half * cx;
    const double b_phi = xx, b_k = -big_f * q.cphi * xy, b_psi = q.ck * xx - ox * xy;
    const double g_phi = xy, g_k = big_f * q.cphi * xx, g_psi = ox * xx + q.ck * xy;
    const double cb = at[COS_B][i], cb2 = cb * cb;
    const double p[3] = {weight * (b_k * g_psi - b_psi * g_k), cb * (x_psi * g_k - x_k * g_psi),
                         cb2 * (x_k * b_psi - x_psi * b_k)};
    const double kappa[3] = {weight * (b_psi * g_phi - b_phi * g_psi), cb * (x_phi * g_psi - x_psi * g_phi),
                             cb2 * (x_psi * b_phi - x_phi * b_psi)};
    const double s[3] = {weight * (b_phi * g_k - b_k * g_phi), cb * (x_k * g_phi - x_phi * g_k),
                         cb2 * (x_phi * b_k - x_k * b_phi)};
    for (int n = 0; n < 3; n++) {
        e[n] = t_phi * p[n] + t_k * kappa[n] + t_psi * s[n];
        e[3 + n] = flat2 * p[n];
        e[6 + n] = d3 * kappa[n];
    }
}

static struct sizes sizes_of(const struct design *d) {
    struct sizes k = {.a = d->base / 2, .c = d->platform / 2, .length = d->length, .l2 = d->length * d->length,
                      .r = d->base / sqrt(3.0), .big_r = d->platform / sqrt(3.0)};
    /* The cotangent of the largest |kappa|, where the links are stretched. */
    const double cosine = (k.a * k.a + k.c * k.c - k.l2) / (2.0 * k.a * k.c);
    k.sign = k.a >= k.c ? 1.0 : -1.0;
    k.far_cos = fabs(cosine) < 1.0 ? cosine / sqrt(1.0 - cosine * cosine) : copysign(1e9, cosine);
    return k;
}

static int indices(const void *design, column *pose, int count, double *lci) {
    const struct design *d = design;
    const struct sizes sizes = sizes_of(d), *k = &sizes;
    const double weight = d->characteristic;
    column at[COLUMNS] ALIGNED, done[COLUMNS] ALIGNED, margin ALIGNED, certain ALIGNED;
    SIMD for (int i = 0; i < BLOCK; i++) {
        double sb, cb, sg, cg;
        sin_cos(pose[1][i], &sb, &cb);
        sin_cos(pose[2][i], &sg, &cg);
        const double m = cb * sg, level = cb * cg, mu = sqrt(sb * sb + level * level) + TINY;
        double end = greater(lesser(fabs(m) * k->far_cos / mu, 1.0), -1.0);
        end = fabs(m) < 1e-15 && end < 1e-8 ? 1e-8 : end;
        const double far = lesser(sqrt((1.0 - end) / (1.0 + end + TINY)), FAR);
        at[X][i] = pose[0][i] + 0.5 * k->r;
        at[M][i] = m, at[MU][i] = mu, at[SIN_W][i] = sb / mu, at[COS_W][i] = level / mu;
        at[COS_B][i] = cb, at[FAR_U][i] = at[HIGH][i] = far;
        at[SIDE][i] = at[BEFORE][i] = at[SEARCHING][i] = 1.0;
        at[T][i] = at[T1][i] = at[LOW][i] = at[E1][i] = at[G_LOW][i] = at[G_HIGH][i] = 0.0;
    }
    int number = 0;
    for (int j = 0; j < POINTS && count; j++) {
        const int padded = whole_vectors(count);
        if (j == 0)
            SIMD for (int i = 0; i < padded; i++) step(k, at, i, 0);
        else
            SIMD for (int i = 0; i < padded; i++) step(k, at, i, j);
        if (j < 3) continue;
        const double accepted = j < POINTS - 1 ? CONVERGED * k->length : DBL_MAX;
        SIMD for (int i = 0; i < padded; i++) margin[i] = accepted - fabs(at[E1][i]);
        const int more = pack(at, done, number, COLUMNS, margin, 1, count);
        if (more > number) count = pack(at, at, 0, COLUMNS, margin, 0, count);
        number = more;
    }
    const int padded = whole_vectors(number);
    SIMD for (int i = 0; i < padded; i++) margin[i] = slack(d, k, done, i);
    const int kept = keep(done, COLUMNS, margin, number), whole = whole_vectors(kept);
    SIMD for (int i = 0; i < whole; i++) {
        double e[ENTRIES];
        entries(k, weight, done, i, e);
        lci[i] = inverse_condition(e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8], certain + i);
    }
#define ENTRIES_OF(i, e) entries(k, weight, done, i, e)
    LOOK_AGAIN(kept, certain, lci, ENTRIES_OF);
    return kept;
}

EXPORT_SWEEP(indices)
