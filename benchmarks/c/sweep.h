/* What the C references share: sampling, the loop over blocks, conditioning, sums.
 *
 * A mechanism defines DIMENSION (pose coordinates), ORDER (rows of the Jacobian) and the type of its
 * constants, includes this file and hands sweep_blocks a function that, for a block of poses, writes
 * the conditioning index of those within every limit and returns their number.
 *
 * Poses lie in columns of BLOCK, so that every loop over poses is a SIMD loop. Poses out of reach are
 * dropped before anything else is computed of the rest. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

#define BLOCK 512
#define TINY 1e-300
#define ALIGNED __attribute__((aligned(64)))
#define INLINE static inline __attribute__((always_inline))
#define SIMD _Pragma("GCC ivdep")

/* A vector longer than a block: columns of 4096 bytes would all compete for the same cache lines. */
typedef double column[BLOCK + 8];

INLINE double lesser(double a, double b) { return a < b ? a : b; }
INLINE double greater(double a, double b) { return a > b ? a : b; }
INLINE double square(double a) { return a * a; }

/* Loops over kept poses run to a whole number of vectors; what lies between is never read. */
INLINE int whole_vectors(int count) { return (count + 7) & ~7; }

/* Points first .. first + BLOCK - 1 of the additive recurrence, in 64-bit phases. */
static void fill(const uint64_t *step, const uint64_t *start, int64_t first, const double *lower,
                 const double *width, column *pose) {
    for (int d = 0; d < DIMENSION; d++) {
        const uint64_t stride = step[d], base = start[d] + (uint64_t)first * stride;
        const double low = lower[d], scale = width[d] * 0x1p-64;
        double *row = pose[d];
        SIMD for (int i = 0; i < BLOCK; i++) row[i] = low + scale * (double)(base + i * stride);
    }
}

/* Copy the poses of some columns whose margin is >= 0 (or is not) to `to`, behind the `at` poses that
 * are there, and return how many are there then. In place where `to` is `from` and `at` 0. */
static int pack(column *from, column *to, int at, int number, const double *margin, int wanted, int count) {
#ifdef __AVX512F__
    const __m512d zero = _mm512_setzero_pd();
    for (int i = 0; i < count; i += 8) {
        __mmask8 chosen = _mm512_cmp_pd_mask(_mm512_load_pd(margin + i), zero, _CMP_GE_OQ);
        if (!wanted) chosen = ~chosen;
        if (i + 8 > count) chosen &= (1 << (count - i)) - 1;
        if (!chosen) continue;
        const int some = __builtin_popcount(chosen);
        const __mmask8 front = (1 << some) - 1;
        for (int c = 0; c < number; c++)
            _mm512_mask_storeu_pd(to[c] + at, front,
                                  _mm512_maskz_compress_pd(chosen, _mm512_load_pd(from[c] + i)));
        at += some;
    }
#else
    for (int i = 0; i < count; i++)
        if ((margin[i] >= 0.0) == wanted) {
            for (int c = 0; c < number; c++) to[c][at] = from[c][i];
            at++;
        }
#endif
    return at;
}

/* Move the poses whose margin is >= 0 to the front of their columns and return their number. */
static int keep(column *columns, int number, const double *margin, int count) {
    return pack(columns, columns, 0, number, margin, 1, count);
}

/* Sine and cosine of angles of at most a few turns: the polynomials of fdlibm. */
INLINE void sin_cos(double angle, double *sine, double *cosine) {
    const double turns = floor(angle * 0.6366197723675814 + 0.5);
    const double r = (angle - turns * 1.57079632673412561417e+00) - turns * 6.07710050650619224932e-11;
    const double z = r * r, z2 = z * z;
    const double s = r + r * z * ((-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03) +
                                  z2 * ((-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06) +
                                        z2 * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
    const double c = 1.0 - 0.5 * z +
                     z2 * ((4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) +
                           z2 * ((2.48015872894767294178e-05 + z * -2.75573143513906633035e-07) +
                                 z2 * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)));
    const int64_t quadrant = (int64_t)turns;
    const double sin_r = quadrant & 1 ? c : s, cos_r = quadrant & 1 ? s : c;
    *sine = quadrant & 2 ? -sin_r : sin_r;
    *cosine = (quadrant + 1) & 2 ? -cos_r : cos_r;
}

#define ENTRIES (ORDER * ORDER)

/* Matrices whose rotations are done together: they stay in the first-level cache. After five sweeps
 * the index of 5x5 matrices is right to 1e-12. */
#define CHUNK 64
#define MOST_SWEEPS 5

/* Smallest over largest singular value of `count` <= CHUNK matrices by one-sided Jacobi (Hestenes).
 * work[row * ORDER + column][point] is used up. */
static void jacobi(double (*restrict work)[CHUNK], int count, double *restrict lci) {
    double norm[ORDER][CHUNK] ALIGNED;
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        int rotated = 0;
        for (int q = 0; q < ORDER; q++)
            SIMD for (int i = 0; i < count; i++) {
                double sum = 0.0;
                for (int r = 0; r < ORDER; r++) sum += square(work[r * ORDER + q][i]);
                norm[q][i] = sum;
            }
        for (int p = 0; p < ORDER - 1; p++)
            for (int q = p + 1; q < ORDER; q++) {
                int far = 0;
                SIMD for (int i = 0; i < count; i++) {
                    double pq = 0.0;
                    for (int r = 0; r < ORDER; r++) pq += work[r * ORDER + p][i] * work[r * ORDER + q][i];
                    const double pp = norm[p][i], qq = norm[q][i];
                    /* Convergence is quadratic: after columns this near to a right angle the next
                     * ones are so to rounding. */
                    far |= pq * pq > 1e-12 * (pp * qq);
                    const double gap = qq - pp, twice = 2.0 * pq;
                    double t = twice / (fabs(gap) + sqrt(gap * gap + twice * twice) + TINY);
                    t = gap >= 0.0 ? t : -t;
                    norm[p][i] = pp - t * pq;
                    norm[q][i] = qq + t * pq;
                    const double c = 1.0 / sqrt(1.0 + t * t), s = c * t;
                    for (int r = 0; r < ORDER; r++) {
                        const double x = work[r * ORDER + p][i], y = work[r * ORDER + q][i];
                        work[r * ORDER + p][i] = c * x - s * y;
                        work[r * ORDER + q][i] = s * x + c * y;
                    }
                }
                rotated |= far;
            }
        if (!rotated) break;
    }
    SIMD for (int i = 0; i < count; i++) {
        double smallest = DBL_MAX, largest = 0.0;
        for (int q = 0; q < ORDER; q++) {
            double sum = 0.0;
            for (int r = 0; r < ORDER; r++) sum += square(work[r * ORDER + q][i]);
            smallest = lesser(smallest, sum);
            largest = greater(largest, sum);
        }
        lci[i] = sqrt(smallest / (largest + TINY));
    }
}

#if ORDER == 3

/* Smallest over largest singular value of [[a, b, c], [d, e, f], [g, h, i]] in closed form; *certain
 * is >= 0 where the error is below 1e-12.
 *
 * The largest eigenvalue l1 of A A^T comes from the trigonometric formula, the others from
 * l1 l2 l3 = det^2 and l1 (l2 + l3) + l2 l3 = |adj A|^2. Digits are lost where the two largest
 * (1 + cosine is small) or the two smallest (gap is small) coincide and near rank one. */
INLINE double inverse_condition(double a, double b, double c, double d, double e, double f, double g,
                                double h, double i, double *certain) {
    const double g11 = a * a + b * b + c * c, g22 = d * d + e * e + f * f, g33 = g * g + h * h + i * i;
    const double g12 = a * d + b * e + c * f, g13 = a * g + b * h + c * i, g23 = d * g + e * h + f * i;
    const double mean = (g11 + g22 + g33) * (1.0 / 3.0);
    const double d1 = g11 - mean, d2 = g22 - mean, d3 = g33 - mean;
    const double off = g12 * g12 + g13 * g13 + g23 * g23;
    const double spread2 = (d1 * d1 + d2 * d2 + d3 * d3 + 2.0 * off) * (1.0 / 6.0), spread = sqrt(spread2);
    const double half_det = 0.5 * (d1 * (d2 * d3 - g23 * g23) - g12 * (g12 * d3 - g23 * g13) +
                                   g13 * (g12 * g23 - d2 * g13));
    double cosine = half_det / (spread2 * spread + TINY);
    cosine = greater(lesser(cosine, 1.0), -1.0);
    /* cos(acos(cosine) / 3) as a polynomial in the cosine of half the angle. */
    const double half = 0.5 + 0.5 * cosine, t = 2.0 * sqrt(half) - 1.0;
    const double t2 = t * t, t4 = t2 * t2, t8 = t4 * t4;
    const double p0 = (0.7660444431189826 + t * 0.24740906632332238) +
                      t2 * (-0.015509188437108442 + t * 0.002466352797696547);
    const double p4 = (-0.0005041246782134169 + t * 0.0001164256388317587) +
                      t2 * (-2.8920038454252404e-05 + t * 7.540205814466724e-06);
    const double p8 = (-2.035474880060599e-06 + t * 5.662405600980584e-07) +
                      t2 * (-1.6036490574254682e-07 + t * 4.3216955795452874e-08);
    const double p12 = (-1.2418365963074522e-08 + t * 5.576785718739665e-09) + t2 * -1.707050210994795e-09;
    const double l1 = mean + 2.0 * spread * ((p0 + t4 * p4) + t8 * (p8 + t4 * p12));

    const double m11 = e * i - f * h, m12 = f * g - d * i, m13 = d * h - e * g;
    const double m21 = c * h - b * i, m22 = a * i - c * g, m23 = b * g - a * h;
    const double m31 = b * f - c * e, m32 = c * d - a * f, m33 = a * e - b * d;
    const double det = a * m11 + b * m12 + c * m13;
    const double minors = (m11 * m11 + m12 * m12 + m13 * m13) + (m21 * m21 + m22 * m22 + m23 * m23) +
                          (m31 * m31 + m32 * m32 + m33 * m33);
    const double inverse = 1.0 / (l1 + TINY), product = det * det * inverse;
    const double half_sum = 0.5 * (minors - product) * inverse;
    const double gap = half_sum * half_sum - product;
    const double l2 = lesser(half_sum + sqrt(greater(gap, 0.0)), l1);
    const double l3 = lesser(product / (l2 + TINY), l2);
    *certain = lesser(half - 1e-6, lesser(gap - 1e-7 * half_sum * half_sum, half_sum - 1e-8 * l1));
    return sqrt(l3 * inverse);
}

/* A second look at the matrices that the closed form is not certain of; entries_of(i, e) writes the
 * entries of pose i, a macro or function of the mechanism. */
#define LOOK_AGAIN(count, certain, lci, entries_of)                                           \
    do {                                                                                      \
        double work_[ENTRIES][CHUNK] ALIGNED, again_[CHUNK] ALIGNED, least_ = 0.0;            \
        int index_[CHUNK], doubtful_ = 0;                                                     \
        SIMD for (int i_ = 0; i_ < (count); i_++) least_ = lesser(least_, (certain)[i_]);     \
        for (int i_ = 0; i_ < (count) && least_ < 0.0; i_++) {                                \
            if ((certain)[i_] < 0.0) {                                                        \
                double e_[ENTRIES];                                                           \
                entries_of(i_, e_);                                                           \
                for (int k_ = 0; k_ < ENTRIES; k_++) work_[k_][doubtful_] = e_[k_];           \
                index_[doubtful_++] = i_;                                                     \
            }                                                                                 \
            if (doubtful_ == CHUNK || (doubtful_ && i_ == (count) - 1)) {                     \
                jacobi(work_, doubtful_, again_);                                             \
                for (int k_ = 0; k_ < doubtful_; k_++) (lci)[index_[k_]] = again_[k_];        \
                doubtful_ = 0;                                                                \
            }                                                                                 \
        }                                                                                     \
    } while (0)

#endif

/* Write the indices of the poses of a block that are within the limits and return their number; the
 * block's columns are used up. */
typedef int (*block_function)(const void *design, column *pose, int count, double *lci);

/* Sum over the points first .. last - 1 of every replicate.
 *
 * statistics (replicates, 4): points within, sum, smallest and largest of their indices.
 * above (replicates, edges): points with an index of at least each edge. */
static void sweep_blocks(block_function indices, const void *design, const uint64_t *step,
                         const uint64_t *start, int replicates, int64_t first, int64_t last,
                         const double *lower, const double *width, const double *edges, int edge_count,
                         double *statistics, int64_t *above) {
    column pose[DIMENSION] ALIGNED, lci ALIGNED;
    memset(above, 0, sizeof(*above) * replicates * edge_count);
    for (int r = 0; r < replicates; r++) {
        int64_t within = 0;
        double total = 0.0, smallest = DBL_MAX, largest = -DBL_MAX;
        for (int64_t block = first; block < last; block += BLOCK) {
            const int count = last - block < BLOCK ? (int)(last - block) : BLOCK;
            fill(step, start + r * DIMENSION, block, lower, width, pose);
            const int kept = indices(design, pose, count, lci);
            within += kept;
            SIMD for (int i = 0; i < kept; i++) {
                total += lci[i];
                smallest = lesser(smallest, lci[i]);
                largest = greater(largest, lci[i]);
            }
            for (int e = 0; e < edge_count; e++) {
                const double edge = edges[e];
                int64_t some = 0;
                SIMD for (int i = 0; i < kept; i++) some += lci[i] >= edge;
                above[r * edge_count + e] += some;
            }
        }
        double *row = statistics + 4 * r;
        row[0] = (double)within;
        row[1] = total;
        row[2] = smallest;
        row[3] = largest;
    }
}

/* The function of each library: `design` are its constants as doubles. */
#define EXPORT_SWEEP(indices)                                                                        \
    void sweep(const double *design, const uint64_t *step, const uint64_t *start, int replicates,    \
               int64_t first, int64_t last, const double *lower, const double *width,                \
               const double *edges, int edge_count, double *statistics, int64_t *above) {            \
        sweep_blocks(indices, design, step, start, replicates, first, last, lower, width, edges,     \
                     edge_count, statistics, above);                                                 \
    }
