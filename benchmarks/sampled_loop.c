/* Joint of Huang (2003), eq. (4), with PD control, gravity compensation and observer: the algorithm
 * of flexid.simulation.sampled, written by hand as by an engineer.
 *
 * Sensors may have noise and a resolution. The input is limited and constant over a sample. The plant
 * takes one classical Runge-Kutta step per sample. The observer is that of observer.c, with constant
 * inputs.
 */
#include <math.h>
#include <stddef.h>

typedef struct {
    double x1, x2, x3, x4;
} state_t;

typedef struct {
    double theta1, theta2, alpha1, alpha2;
} coefficients_t;

/* One row of the log. */
typedef struct {
    state_t state;
    double input;
    coefficients_t estimates, errors;
    double tracking;
    state_t measured;
} row_t;

typedef struct {
    double gravity_torque, stiffness, proportional, derivative;
    double amplitude, frequency, limit;
} law_t;

static inline state_t rates(state_t x, double u, const coefficients_t *p, double beta1)
{
    const double twist = x.x1 - x.x3;
    return (state_t){x.x2, -p->theta1 * sin(x.x1) - p->theta2 * twist, x.x4,
                     p->alpha1 * twist - p->alpha2 * x.x4 + beta1 * u};
}

static inline state_t ahead(state_t x, double h, state_t d)
{
    return (state_t){x.x1 + h * d.x1, x.x2 + h * d.x2, x.x3 + h * d.x3, x.x4 + h * d.x4};
}

static inline state_t runge_kutta(state_t x, double u, const coefficients_t *p, double beta1, double h)
{
    const state_t a = rates(x, u, p, beta1);
    const state_t b = rates(ahead(x, 0.5 * h, a), u, p, beta1);
    const state_t c = rates(ahead(x, 0.5 * h, b), u, p, beta1);
    const state_t d = rates(ahead(x, h, c), u, p, beta1);
    const double w = h / 6.0;
    return (state_t){x.x1 + w * (a.x1 + 2.0 * (b.x1 + c.x1) + d.x1),
                     x.x2 + w * (a.x2 + 2.0 * (b.x2 + c.x2) + d.x2),
                     x.x3 + w * (a.x3 + 2.0 * (b.x3 + c.x3) + d.x3),
                     x.x4 + w * (a.x4 + 2.0 * (b.x4 + c.x4) + d.x4)};
}

#ifndef IDEAL_SENSORS
static inline double quantised(double x, double resolution)
{
    return resolution * floor(x / resolution + 0.5);
}
#endif

/* n samples with sample time h, starting at rest; true coefficients p, observer gains c1 and c2,
 * initial estimates start. noise: standard normal numbers, scaled by the deviations position and
 * velocity, or NULL. Fills n rows. */
void run(size_t n, double h, const coefficients_t *p, double beta1, const law_t *law, double c1, double c2,
         const coefficients_t *start, const state_t *noise, double position, double velocity,
         double resolution, row_t *restrict rows)
{
    state_t x = {0.0, 0.0, 0.0, 0.0};
    coefficients_t q = *start;
    const double slope = law->gravity_torque / law->stiffness;
    double f1 = 0.0, twist = 0.0, x2 = 0.0, x4 = 0.0, known = 0.0;

    for (size_t i = 0; i < n; ++i) {
        state_t seen = x;
#ifndef IDEAL_SENSORS
        if (noise)
            seen = (state_t){x.x1 + position * noise[i].x1, x.x2 + velocity * noise[i].x2,
                             x.x3 + position * noise[i].x3, x.x4 + velocity * noise[i].x4};
        if (resolution > 0.0) {
            seen.x1 = quantised(seen.x1, resolution);
            seen.x3 = quantised(seen.x3, resolution);
        }
#endif

        const double phase = law->frequency * ((double)i * h);
        const double qd = law->amplitude * sin(phase), qd_1 = law->amplitude * law->frequency * cos(phase);
        const double sine = sin(qd), place = qd + slope * sine, speed = qd_1 * (1.0 + slope * cos(qd));
        double u = law->derivative * (speed - seen.x4) + law->gravity_torque * sine
                   + law->proportional * (place - seen.x3);
        if (fabs(u) > law->limit)
            u = copysign(law->limit, u);

        const double new_f1 = -sin(seen.x1), new_twist = seen.x1 - seen.x3;
        if (i > 0) {
            const double m1 = 0.5 * (f1 + new_f1), m = 0.5 * (twist + new_twist);
            const double m4 = -0.5 * (x4 + seen.x4);

            const double link = seen.x2 - x2 - h * (m1 * q.theta1 - m * q.theta2);
            double s = h * c1 * (m1 * m1 + m * m);
            double gain = c1 * link * (1.0 + 0.5 * s) / (1.0 + s * (1.0 + 0.5 * s));
            q.theta1 += m1 * gain;
            q.theta2 -= m * gain;

            const double motor = seen.x4 - x4 - h * (known + m * q.alpha1 + m4 * q.alpha2);
            s = h * c2 * (m * m + m4 * m4);
            gain = c2 * motor * (1.0 + 0.5 * s) / (1.0 + s * (1.0 + 0.5 * s));
            q.alpha1 += m * gain;
            q.alpha2 += m4 * gain;
        }
        f1 = new_f1, twist = new_twist, x2 = seen.x2, x4 = seen.x4, known = beta1 * u;

        row_t *row = &rows[i];
        row->state = x;
        row->input = u;
        row->estimates = q;
        row->errors = (coefficients_t){q.theta1 - p->theta1, q.theta2 - p->theta2,
                                       q.alpha1 - p->alpha1, q.alpha2 - p->alpha2};
        row->tracking = x.x1 - qd;
        row->measured = seen;
        x = runge_kutta(x, u, p, beta1, h);
    }
}
