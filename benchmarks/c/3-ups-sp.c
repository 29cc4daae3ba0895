/* 3-UPS/SP: three UPS limbs around an SP one, three rotations and one translation. */
#define DIMENSION 4
#define ORDER 4
#include "sweep.h"

struct design {
    double base;              /* half the base's side */
    double arm[3][2];         /* e_i = b_i - b_4 in the platform */
    double scale;             /* 1 / characteristic length */
    double low[4], high[4];   /* strokes */
};

enum { SIN_PHI, COS_PHI, SIN_THETA, COS_THETA, SIN_PSI, COS_PSI, L4, COLUMNS };

static const double corner[3][2] = {{1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}};

/* Rz(phi) Ry(theta) Rx(psi). */
INLINE void rotation(column *state, int i, double *r) {
    const double sz = state[SIN_PHI][i], cz = state[COS_PHI][i], sy = state[SIN_THETA][i],
                 cy = state[COS_THETA][i], sx = state[SIN_PSI][i], cx = state[COS_PSI][i];
    r[0] = cz * cy, r[1] = cz * sy * sx - sz * cx, r[2] = cz * sy * cx + sz * sx;
    r[3] = sz * cy, r[4] = sz * sy * sx + cz * cx, r[5] = sz * sy * cx - cz * sx;
    r[6] = -sy, r[7] = cy * sx, r[8] = cy * cx;
}

/* s = R ((0, 0, l4) + e) and n = B - A of limb k. */
INLINE void limb(const struct design *d, int k, const double *r, double l4, double *s, double *n) {
    const double ex = d->arm[k][0], ey = d->arm[k][1];
    s[0] = r[0] * ex + r[1] * ey + r[2] * l4;
    s[1] = r[3] * ex + r[4] * ey + r[5] * l4;
    s[2] = r[6] * ex + r[7] * ey + r[8] * l4;
    n[0] = s[0] - d->base * (1.0 + corner[k][0]);
    n[1] = s[1] - d->base * (1.0 + corner[k][1]);
    n[2] = s[2];
}

static int indices(const void *design, column *pose, int count, double *lci) {
    const struct design *d = design;
    column state[COLUMNS] ALIGNED, margin ALIGNED;
    SIMD for (int i = 0; i < BLOCK; i++) {
        sin_cos(pose[0][i], &state[SIN_PHI][i], &state[COS_PHI][i]);
        sin_cos(pose[1][i], &state[SIN_THETA][i], &state[COS_THETA][i]);
        sin_cos(pose[2][i], &state[SIN_PSI][i], &state[COS_PSI][i]);
        const double l4 = state[L4][i] = pose[3][i];
        double r[9], s[3], n[3];
        rotation(state, i, r);
        double slack = lesser(l4 - d->low[3], d->high[3] - l4);
        for (int k = 0; k < 3; k++) {
            limb(d, k, r, l4, s, n);
            const double length2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
            slack = lesser(slack, lesser(length2 - square(d->low[k]), square(d->high[k]) - length2));
        }
        margin[i] = slack;
    }
    const int kept = keep(state, COLUMNS, margin, count);
    for (int chunk = 0; chunk < kept; chunk += CHUNK) {
        const int some = kept - chunk < CHUNK ? kept - chunk : CHUNK, padded = whole_vectors(some);
        double work[ENTRIES][CHUNK] ALIGNED;
        SIMD for (int j = 0; j < padded; j++) {
            const int i = chunk + j;
            const double sz = state[SIN_PHI][i], cz = state[COS_PHI][i], l4 = state[L4][i];
            double r[9], s[3], n[3];
            rotation(state, i, r);
            for (int k = 0; k < 3; k++) {
                limb(d, k, r, l4, s, n);
                const double unit = 1.0 / (sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) + TINY);
                const double turn = unit * d->scale;
                const double mx = s[1] * n[2] - s[2] * n[1], my = s[2] * n[0] - s[0] * n[2],
                             mz = s[0] * n[1] - s[1] * n[0];
                work[4 * k + 0][j] = mz * turn;
                work[4 * k + 1][j] = (my * cz - mx * sz) * turn;
                work[4 * k + 2][j] = (mx * r[0] + my * r[3] + mz * r[6]) * turn;
                work[4 * k + 3][j] = (n[0] * r[2] + n[1] * r[5] + n[2] * r[8]) * unit;
            }
            work[12][j] = work[13][j] = work[14][j] = 0.0;
            work[15][j] = 1.0;
        }
        jacobi(work, padded, lci + chunk);
    }
    return kept;
}

EXPORT_SWEEP(indices)
