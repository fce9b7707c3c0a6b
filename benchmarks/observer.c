/* Huang (2003), eqs. (2)-(3) for the flexible joint, sampled: the algorithm of
 * flexid.paper.parametric_observer, written by hand as by an embedded engineer.
 *
 * Between two samples p' = G r (v' - r'p - k) is solved with the mean regressor of the interval;
 * exp(-s) is replaced by 1/(1 + s + s*s/2).
 */
#include <math.h>
#include <stddef.h>

typedef struct {
    double x1, x2, x3, x4, u;
} sample_t;

typedef struct {
    double theta1, theta2, alpha1, alpha2;
} estimate_t;

typedef struct {
    double link, motor;
} innovation_t;

/* n samples with sample time h, gains g[4], input gain beta1; inputs are linear between samples.
 * p: initial estimates. Fills n estimates and n innovations. */
void replay(const sample_t *restrict sample, size_t n, double h, double beta1,
            const double *restrict g, estimate_t p, estimate_t *restrict estimates,
            innovation_t *restrict innovations)
{
    const double g1 = g[0], g2 = g[1], g3 = g[2], g4 = g[3];
    double f1 = -sin(sample[0].x1), twist = sample[0].x1 - sample[0].x3;
    double x2 = sample[0].x2, x4 = sample[0].x4, u = sample[0].u;

    estimates[0] = p;
    innovations[0].link = innovations[0].motor = NAN;
    for (size_t i = 1; i < n; ++i) {
        const sample_t *now = &sample[i];
        const double new_f1 = -sin(now->x1), new_twist = now->x1 - now->x3;
        const double m1 = 0.5 * (f1 + new_f1), m = 0.5 * (twist + new_twist);
        const double m4 = -0.5 * (x4 + now->x4), known = 0.5 * beta1 * (u + now->u);

        const double link = now->x2 - x2 - h * (m1 * p.theta1 - m * p.theta2);
        double s = h * (g1 * m1 * m1 + g2 * m * m);
        double gain = link * (1.0 + 0.5 * s) / (1.0 + s * (1.0 + 0.5 * s));
        p.theta1 += g1 * m1 * gain;
        p.theta2 -= g2 * m * gain;

        const double motor = now->x4 - x4 - h * (known + m * p.alpha1 + m4 * p.alpha2);
        s = h * (g3 * m * m + g4 * m4 * m4);
        gain = motor * (1.0 + 0.5 * s) / (1.0 + s * (1.0 + 0.5 * s));
        p.alpha1 += g3 * m * gain;
        p.alpha2 += g4 * m4 * gain;

        estimates[i] = p;
        innovations[i].link = link;
        innovations[i].motor = motor;
        f1 = new_f1, twist = new_twist, x2 = now->x2, x4 = now->x4, u = now->u;
    }
}
