/* Parametric observer, Huang (2003), of the model flexible joint.
 * state           x1, x2, x3, x4
 * input           u
 * input_rate      none
 * observer_state  y1, y2, z1, z2
 * gain            c1, c2
 * constant        beta1
 * estimate        theta1, theta2, alpha1, alpha2
 */
#include <math.h>

void observer_estimates(
    const double *state,
    const double *input,
    const double *input_rate,
    const double *observer_state,
    const double *gain,
    const double *constant,
    double *estimate)
{
    (void)input;
    (void)input_rate;
    (void)constant;
    const double x1 = state[0];
    const double x2 = state[1];
    const double x3 = state[2];
    const double x4 = state[3];
    const double y1 = observer_state[0];
    const double y2 = observer_state[1];
    const double z1 = observer_state[2];
    const double z2 = observer_state[3];
    const double c1 = gain[0];
    const double c2 = gain[1];
    estimate[0] = y1 - c1*x2*sin(x1);
    estimate[1] = y2 - c1*x2*(x1 - x3);
    estimate[2] = z1 + c2*x4*(x1 - x3);
    estimate[3] = z2 - 1.0/2.0*c2*(x4*x4);
}

void observer_rates(
    const double *state,
    const double *input,
    const double *input_rate,
    const double *observer_state,
    const double *gain,
    const double *constant,
    double *rate)
{
    (void)input_rate;
    const double x1 = state[0];
    const double x2 = state[1];
    const double x3 = state[2];
    const double x4 = state[3];
    const double u = input[0];
    const double y1 = observer_state[0];
    const double y2 = observer_state[1];
    const double z1 = observer_state[2];
    const double z2 = observer_state[3];
    const double c1 = gain[0];
    const double c2 = gain[1];
    const double beta1 = constant[0];
    const double theta1_hat = y1 - c1*x2*sin(x1);
    const double theta2_hat = y2 - c1*x2*(x1 - x3);
    const double alpha1_hat = z1 + c2*x4*(x1 - x3);
    const double alpha2_hat = z2 - 1.0/2.0*c2*(x4*x4);
    const double s = theta1_hat*sin(x1) + theta2_hat*(x1 - x3);
    const double r = alpha1_hat*(x1 - x3) - alpha2_hat*x4 + beta1*u;
    rate[0] = -c1*(s*sin(x1) - (x2*x2)*cos(x1));
    rate[1] = -c1*(s*(x1 - x3) - x2*(x2 - x4));
    rate[2] = -c2*(r*(x1 - x3) + x4*(x2 - x4));
    rate[3] = c2*r*x4;
}
