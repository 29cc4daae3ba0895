/* 2PaUU-PPaP: two crank limbs and a prismatic one, three translations. Symbols as in the paper. */
#define DIMENSION 3
#define ORDER 3
#include "sweep.h"

struct design {
    double m, n, l1, l2, c;
    double sign1, sign2; /* of the roots of the working mode */
    double top;          /* largest z */
};

/* det(J_q) J^-1 at a pose: with S_i = sqrt(A^2 + B^2 - C^2), u_i . e_i = S_i / 2, and the sums
 * a + l1 cos t, b + l1 sin t of the links need no angle. */
INLINE void entries(const struct design *k, double x, double y, double z, double *e) {
    const double span = k->m - k->n, b = z - 2.0 * k->c, l1 = k->l1;
    const double rest = y * y + b * b, excess = l1 * l1 - k->l2 * k->l2;
    const double a1 = span - x, a2 = span + x;
    const double r1 = a1 * a1 + b * b, r2 = a2 * a2 + b * b;
    const double c1 = a1 * a1 + rest + excess, c2 = a2 * a2 + rest + excess;
    const double root1 = k->sign1 * sqrt(greater(4.0 * l1 * l1 * r1 - c1 * c1, 0.0));
    const double root2 = k->sign2 * sqrt(greater(4.0 * l1 * l1 * r2 - c2 * c2, 0.0));
    const double half1 = 0.5 / (r1 + TINY), half2 = 0.5 / (r2 + TINY);
    const double x1 = a1 - (a1 * c1 + b * root1) * half1, z1 = b + (a1 * root1 - b * c1) * half1;
    const double x2 = a2 - (a2 * c2 + b * root2) * half2, z2 = b + (a2 * root2 - b * c2) * half2;
    const double q1 = 0.5 * root1, q2 = 0.5 * root2;
    e[0] = -x1 * q2, e[1] = y * q2, e[2] = z1 * q2;
    e[3] = x2 * q1, e[4] = y * q1, e[5] = z2 * q1;
    e[6] = 0.0, e[7] = q1 * q2, e[8] = 0.0;
}

static int indices(const void *design, column *pose, int count, double *lci) {
    const struct design *k = design;
    const double span = k->m - k->n, height = 2.0 * k->c, top = k->top;
    const double four = 4.0 * k->l1 * k->l1, excess = k->l1 * k->l1 - k->l2 * k->l2;
    column margin ALIGNED, certain ALIGNED;
    SIMD for (int i = 0; i < BLOCK; i++) {
        const double x = pose[0][i], y = pose[1][i], z = pose[2][i];
        const double a1 = span - x, a2 = span + x, b = z - height, b2 = b * b, y2 = y * y + excess;
        const double r1 = a1 * a1 + b2, r2 = a2 * a2 + b2;
        const double within1 = four * r1 - square(r1 + y2), within2 = four * r2 - square(r2 + y2);
        margin[i] = lesser(lesser(within1, within2), top - z);
    }
    const int kept = keep(pose, DIMENSION, margin, count), padded = whole_vectors(kept);
    SIMD for (int i = 0; i < padded; i++) {
        double e[ENTRIES];
        entries(k, pose[0][i], pose[1][i], pose[2][i], e);
        lci[i] = inverse_condition(e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8], certain + i);
    }
#define ENTRIES_OF(i, e) entries(k, pose[0][i], pose[1][i], pose[2][i], e)
    LOOK_AGAIN(kept, certain, lci, ENTRIES_OF);
    return kept;
}

EXPORT_SWEEP(indices)
