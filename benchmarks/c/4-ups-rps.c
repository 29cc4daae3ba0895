/* 4-UPS-RPS: four UPS limbs and an RPS one that guides, three rotations and two translations. */
#define DIMENSION 5
#define ORDER 5
#include "sweep.h"

struct design {
    double anchor[5][2], point[5][2]; /* y and z of T_k in the base and of S_k in the platform */
    double radius;                    /* of the platform */
    double scale;                     /* 1 / characteristic length */
    double low[5], high[5];           /* strokes */
};

enum { X, Y, SIN_A, COS_A, SIN_B, COS_B, SIN_C, COS_C, COLUMNS };

/* Rz(alpha) Ry(beta) Rx(gamma). */
INLINE void rotation(column *state, int i, double *r) {
    const double sz = state[SIN_A][i], cz = state[COS_A][i], sy = state[SIN_B][i], cy = state[COS_B][i],
                 sx = state[SIN_C][i], cx = state[COS_C][i];
    r[0] = cz * cy, r[1] = cz * sy * sx - sz * cx, r[2] = cz * sy * cx + sz * sx;
    r[3] = sz * cy, r[4] = sz * sy * sx + cz * cx, r[5] = sz * sy * cx - cz * sx;
    r[6] = -sy, r[7] = cy * sx, r[8] = cy * cx;
}

/* q = Rot S and L = P + q - T of limb k; the revolute joint makes z = r cos(beta) cos(gamma). */
INLINE void limb(const struct design *d, int k, const double *r, double x, double y, double *q, double *l) {
    const double sy = d->point[k][0], sz = d->point[k][1];
    q[0] = r[1] * sy + r[2] * sz;
    q[1] = r[4] * sy + r[5] * sz;
    q[2] = r[7] * sy + r[8] * sz;
    l[0] = x + q[0];
    l[1] = y + q[1] - d->anchor[k][0];
    l[2] = d->radius * r[8] + q[2] - d->anchor[k][1];
}

static int indices(const void *design, column *pose, int count, double *lci) {
    const struct design *d = design;
    column state[COLUMNS] ALIGNED, margin ALIGNED;
    SIMD for (int i = 0; i < BLOCK; i++) {
        const double x = state[X][i] = pose[0][i], y = state[Y][i] = pose[1][i];
        sin_cos(pose[2][i], &state[SIN_A][i], &state[COS_A][i]);
        sin_cos(pose[3][i], &state[SIN_B][i], &state[COS_B][i]);
        sin_cos(pose[4][i], &state[SIN_C][i], &state[COS_C][i]);
        double r[9], q[3], l[3], slack = DBL_MAX;
        rotation(state, i, r);
        for (int k = 0; k < 5; k++) {
            limb(d, k, r, x, y, q, l);
            const double length2 = l[0] * l[0] + l[1] * l[1] + l[2] * l[2];
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
            const double sin_a = state[SIN_A][i], cos_a = state[COS_A][i], radius = d->radius;
            const double z_beta = -radius * state[SIN_B][i] * state[COS_C][i],
                         z_gamma = -radius * state[COS_B][i] * state[SIN_C][i];
            double r[9], q[3], l[3];
            rotation(state, i, r);
            for (int k = 0; k < 5; k++) {
                limb(d, k, r, state[X][i], state[Y][i], q, l);
                const double unit = 1.0 / (sqrt(l[0] * l[0] + l[1] * l[1] + l[2] * l[2]) + TINY);
                const double turn = unit * d->scale;
                const double mx = q[1] * l[2] - q[2] * l[1], my = q[2] * l[0] - q[0] * l[2],
                             mz = q[0] * l[1] - q[1] * l[0];
                work[5 * k + 0][j] = l[0] * unit;
                work[5 * k + 1][j] = l[1] * unit;
                work[5 * k + 2][j] = mz * turn;
                work[5 * k + 3][j] = (my * cos_a - mx * sin_a + l[2] * z_beta) * turn;
                work[5 * k + 4][j] = (mx * r[0] + my * r[3] + mz * r[6] + l[2] * z_gamma) * turn;
            }
        }
        jacobi(work, padded, lci + chunk);
    }
    return kept;
}

EXPORT_SWEEP(indices)
