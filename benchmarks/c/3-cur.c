/* 3-CUR: three limbs with vertical cylindrical joints, one translation and two rotations.
 *
 * Lengths over L. At a tilt (beta, gamma), in the frame that yaws with the platform, p, alpha and the
 * angles theta_i of the limbs solve p + Rb r_i' - Rz(-alpha) A_i = cos theta_i r_i' + sin theta_i z'.
 * Newton's method follows the solution from the level platform by way of 0.3, 0.6 and 0.8 of the
 * tilt. Poses that have converged leave the iteration. */
#define DIMENSION 3
#define ORDER 3
#include "sweep.h"

#define S60 0.8660254037844386
#define LONGEST 0.5      /* Newton step of an unknown */
#define TOLERANCE 1e-10  /* a gap beyond it is no solution */
#define CONVERGED 1e-9   /* one further step leaves rounding alone */
#define STEPS 7          /* at the full tilt */

struct design {
    double ra, rb, length, d1, characteristic; /* lengths in m */
    double low[3], high[3];                    /* strokes */
    double cos4, sin4, least4, cos5, sin5, least5; /* theta4, theta5 about the middle of their limits */
    double lowest, highest;                    /* sine of the links' elevation */
};

enum { PX, PY, COS, SIN, COS1, SIN1, COS2, SIN2, COS3, SIN3, UNKNOWNS };
enum { Z = UNKNOWNS, SIN_B, COS_B, SIN_G, COS_G, COLUMNS };

/* Horizontal parts of r_1', r_2', r_3' and z'. */
struct tilt {
    double rx[3], ry[3], zx, zy;
};

INLINE struct tilt tilted(double sb, double cb, double sg, double cg) {
    const double tx = S60 * sb * sg, ty = S60 * cg, rx = -0.5 * cb;
    return (struct tilt){{cb, rx + tx, rx - tx}, {0.0, ty, -ty}, sb * cg, -sg};
}

INLINE double short_step(double step) { return greater(lesser(step, LONGEST), -LONGEST); }

/* Cosine and sine turned by a small angle, to second order of a unit vector. */
INLINE void turn(double *c, double *s, double angle) {
    const double tc = *c - angle * *s, ts = *s + angle * *c, scale = 1.5 - 0.5 * (tc * tc + ts * ts);
    *c = tc * scale;
    *s = ts * scale;
}

/* Rz(-alpha) A_i. */
INLINE void anchors(double c, double s, double ra, double *ax, double *ay) {
    const double cx = -0.5 * ra * c, cy = -0.5 * ra * s, sx = S60 * ra * s, sy = S60 * ra * c;
    ax[0] = ra * c, ax[1] = cx + sx, ax[2] = cx - sx;
    ay[0] = -ra * s, ay[1] = sy - cy, ay[2] = -sy - cy;
}

/* One Newton step of u; return the largest gap before it. */
INLINE double newton(double *u, struct tilt at, double ra, double rb) {
    double ax[3], ay[3], nx[3], ny[3], moment[3], gx[3], gy[3], f[3], worst = 0.0;
    anchors(u[COS], u[SIN], ra, ax, ay);
    for (int k = 0; k < 3; k++) {
        const double c = u[COS1 + 2 * k], s = u[SIN1 + 2 * k];
        nx[k] = c * at.zy - s * at.ry[k];
        ny[k] = s * at.rx[k] - c * at.zx;
        moment[k] = ax[k] * ny[k] - ay[k] * nx[k];
        gx[k] = u[PX] + (rb - c) * at.rx[k] - s * at.zx - ax[k];
        gy[k] = u[PY] + (rb - c) * at.ry[k] - s * at.zy - ay[k];
        f[k] = nx[k] * gx[k] + ny[k] * gy[k];
        worst = greater(worst, greater(fabs(gx[k]), fabs(gy[k])));
    }
    /* Across the links three equations are left, in p and alpha: Cramer's rule. */
    const double yz1 = ny[1] * moment[2] - moment[1] * ny[2], zx1 = moment[1] * nx[2] - nx[1] * moment[2],
                 xy1 = nx[1] * ny[2] - ny[1] * nx[2];
    const double det = nx[0] * yz1 + ny[0] * zx1 + moment[0] * xy1;
    const double unit = -det / (det * det + TINY);
    const double dx = short_step(unit * (yz1 * f[0] + (moment[0] * ny[2] - ny[0] * moment[2]) * f[1] +
                                         (ny[0] * moment[1] - moment[0] * ny[1]) * f[2]));
    const double dy = short_step(unit * (zx1 * f[0] + (nx[0] * moment[2] - moment[0] * nx[2]) * f[1] +
                                         (moment[0] * nx[1] - nx[0] * moment[1]) * f[2]));
    const double da = short_step(unit * (xy1 * f[0] + (ny[0] * nx[2] - nx[0] * ny[2]) * f[1] +
                                         (nx[0] * ny[1] - ny[0] * nx[1]) * f[2]));
    /* One division for three: they are what a step waits for. */
    double n2[3];
    for (int k = 0; k < 3; k++) n2[k] = nx[k] * nx[k] + ny[k] * ny[k];
    const double inverse = 1.0 / (n2[0] * n2[1] * n2[2] + TINY);
    const double over[3] = {n2[1] * n2[2], n2[0] * n2[2], n2[0] * n2[1]};
    for (int k = 0; k < 3; k++) {
        const double mx = gx[k] + dx - ay[k] * da, my = gy[k] + dy + ax[k] * da;
        const double along = (nx[k] * my - ny[k] * mx) * (over[k] * inverse);
        turn(&u[COS1 + 2 * k], &u[SIN1 + 2 * k], short_step(along));
    }
    turn(&u[COS], &u[SIN], da);
    u[PX] += dx;
    u[PY] += dy;
    return worst;
}

/* Extrapolate by a share of what the last continuation step did. */
INLINE void ahead(double *u, const double *before, double share) {
    u[PX] += share * (u[PX] - before[PX]);
    u[PY] += share * (u[PY] - before[PY]);
    for (int k = COS; k < UNKNOWNS; k += 2)
        turn(&u[k], &u[k + 1], short_step(share * (u[k + 1] * before[k] - u[k] * before[k + 1])));
}

/* The least slack of a pose, in units that differ: its sign counts. */
INLINE double slack(const struct design *k, column *at, int i) {
    const double sb = at[SIN_B][i], cb = at[COS_B][i], tz = cb * at[SIN_G][i], zz = cb * at[COS_G][i];
    const double rb = k->rb / k->length;
    const double rz[3] = {-sb, S60 * tz + 0.5 * sb, -S60 * tz + 0.5 * sb};
    const double ez[3] = {tz, -0.5 * tz + S60 * sb, -0.5 * tz - S60 * sb};
    double least = DBL_MAX;
    for (int n = 0; n < 3; n++) {
        const double c = at[COS1 + 2 * n][i], s = at[SIN1 + 2 * n][i];
        const double wz = s * zz + c * rz[n], h = at[Z][i] + k->length * (rb * rz[n] - wz) - k->d1;
        least = lesser(least, lesser(h - k->low[n], k->high[n] - h));
        least = lesser(least, lesser(wz, lesser(wz - k->lowest, k->highest - wz)));
        least = lesser(least, wz * k->cos4 + ez[n] * k->sin4 - k->least4 * sqrt(wz * wz + ez[n] * ez[n]));
        least = lesser(least, c * k->cos5 + s * k->sin5 - k->least5);
    }
    return least;
}

/* J^-1 times det F and the w_z of all limbs, with F (x', y', alpha') = l (v, -u) for turns. */
INLINE void entries(const struct design *k, column *at, int i, double *e) {
    const double ra = k->ra / k->length, rb = k->rb / k->length;
    const double sb = at[SIN_B][i], cb = at[COS_B][i], tz = cb * at[SIN_G][i], zz = cb * at[COS_G][i];
    const double rz[3] = {-sb, S60 * tz + 0.5 * sb, -S60 * tz + 0.5 * sb};
    const struct tilt tilt = tilted(sb, cb, at[SIN_G][i], at[COS_G][i]);
    double ax[3], ay[3], u[3], v[3], m[3], wx[3], wy[3], wz[3], l[3];
    anchors(at[COS][i], at[SIN][i], ra, ax, ay);
    for (int n = 0; n < 3; n++) {
        const double c = at[COS1 + 2 * n][i], s = at[SIN1 + 2 * n][i];
        u[n] = c * tilt.zy - s * tilt.ry[n];
        v[n] = s * tilt.rx[n] - c * tilt.zx;
        m[n] = (ax[n] - at[PX][i]) * v[n] - (ay[n] - at[PY][i]) * u[n];
        wx[n] = c * tilt.rx[n] + s * tilt.zx;
        wy[n] = c * tilt.ry[n] + s * tilt.zy;
        wz[n] = s * zz + c * rz[n];
        l[n] = rb * rz[n] - wz[n];
    }
    const double a[3][3] = {
        {v[1] * m[2] - m[1] * v[2], m[0] * v[2] - v[0] * m[2], v[0] * m[1] - m[0] * v[1]},
        {m[1] * u[2] - u[1] * m[2], u[0] * m[2] - m[0] * u[2], m[0] * u[1] - u[0] * m[1]},
        {u[1] * v[2] - v[1] * u[2], v[0] * u[2] - u[0] * v[2], u[0] * v[1] - v[0] * u[1]}};
    const double d = u[0] * a[0][0] + v[0] * a[1][0] + m[0] * a[2][0];
    double about_x[3], about_y[3];
    for (int n = 0; n < 3; n++) {
        about_x[n] = a[n][0] * l[0] * v[0] + a[n][1] * l[1] * v[1] + a[n][2] * l[2] * v[2];
        about_y[n] = -(a[n][0] * l[0] * u[0] + a[n][1] * l[1] * u[1] + a[n][2] * l[2] * u[2]);
    }
    const double scale = k->length / k->characteristic, scale_x = scale * cb;
    const double others[3] = {wz[1] * wz[2], wz[0] * wz[2], wz[0] * wz[1]};
    for (int n = 0; n < 3; n++) {
        const double rx = tilt.rx[n], ry = tilt.ry[n], yaw = rb * (wy[n] * rx - wx[n] * ry);
        const double x = d * rb * (wz[n] * ry - wy[n] * rz[n]) + wx[n] * about_x[0] + wy[n] * about_x[1] +
                         yaw * about_x[2];
        const double y = d * rb * (wx[n] * rz[n] - wz[n] * rx) + wx[n] * about_y[0] + wy[n] * about_y[1] +
                         yaw * about_y[2];
        e[3 * n] = d * others[2] * wz[2];
        e[3 * n + 1] = y * others[n] * scale;
        e[3 * n + 2] = x * others[n] * scale_x;
    }
}

static int indices(const void *design, column *pose, int count, double *lci) {
    const struct design *k = design;
    const double ra = k->ra / k->length, rb = k->rb / k->length, level = rb - ra;
    const double rise = sqrt(greater(1.0 - level * level, 0.0));
    column at[COLUMNS] ALIGNED, solved[COLUMNS] ALIGNED, margin ALIGNED, certain ALIGNED;
    SIMD for (int i = 0; i < BLOCK; i++) {
        const double beta = pose[1][i], gamma = pose[2][i];
        const double home[UNKNOWNS] = {0.0, 0.0, 1.0, 0.0, level, rise, level, rise, level, rise};
        double u[UNKNOWNS], first[UNKNOWNS], second[UNKNOWNS], sb, cb, sg, cg;
        for (int n = 0; n < UNKNOWNS; n++) u[n] = home[n];
        sin_cos(0.3 * beta, &sb, &cb);
        sin_cos(0.3 * gamma, &sg, &cg);
        newton(u, tilted(sb, cb, sg, cg), ra, rb);
        for (int n = 0; n < UNKNOWNS; n++) first[n] = u[n];
        ahead(u, home, 1.0);
        newton(u, tilted(2.0 * sb * cb, 1.0 - 2.0 * sb * sb, 2.0 * sg * cg, 1.0 - 2.0 * sg * sg), ra, rb);
        for (int n = 0; n < UNKNOWNS; n++) second[n] = u[n];
        ahead(u, first, 0.2 / 0.3);
        sin_cos(0.8 * beta, &sb, &cb);
        sin_cos(0.8 * gamma, &sg, &cg);
        newton(u, tilted(sb, cb, sg, cg), ra, rb);
        ahead(u, second, 1.0);
        for (int n = 0; n < UNKNOWNS; n++) at[n][i] = u[n];
        at[Z][i] = pose[0][i];
        sin_cos(beta, &at[SIN_B][i], &at[COS_B][i]);
        sin_cos(gamma, &at[SIN_G][i], &at[COS_G][i]);
    }
    int number = 0;
    for (int step = 0; step <= STEPS && count; step++) {
        const double accepted = step < STEPS ? CONVERGED : TOLERANCE;
        const int padded = whole_vectors(count);
        SIMD for (int i = 0; i < padded; i++) {
            double u[UNKNOWNS];
            for (int n = 0; n < UNKNOWNS; n++) u[n] = at[n][i];
            margin[i] = accepted - newton(u, tilted(at[SIN_B][i], at[COS_B][i], at[SIN_G][i], at[COS_G][i]), ra, rb);
            for (int n = 0; n < UNKNOWNS; n++) at[n][i] = u[n];
        }
        const int more = pack(at, solved, number, COLUMNS, margin, 1, count);
        if (more > number) count = pack(at, at, 0, COLUMNS, margin, 0, count);
        number = more;
    }
    const int padded = whole_vectors(number);
    SIMD for (int i = 0; i < padded; i++) margin[i] = slack(k, solved, i);
    const int kept = keep(solved, COLUMNS, margin, number), whole = whole_vectors(kept);
    SIMD for (int i = 0; i < whole; i++) {
        double e[ENTRIES];
        entries(k, solved, i, e);
        lci[i] = inverse_condition(e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8], certain + i);
    }
#define ENTRIES_OF(i, e) entries(k, solved, i, e)
    LOOK_AGAIN(kept, certain, lci, ENTRIES_OF);
    return kept;
}

EXPORT_SWEEP(indices)
