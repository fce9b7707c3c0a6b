/* Parametric observer, Huang (2003), of the model three inertias.
 * state           q1, v1, q2, v2, q3, v3
 * input           u1, u2
 * input_rate      u1_rate, u2_rate
 * observer_state  y1, y2, z1, z2, z3, w1, w2, w3
 * gain            c1, c2, c3
 * constant        width
 * estimate        a1, a2, b1, b2, b3, d1, d2, d3
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
    (void)input_rate;
    const double q1 = state[0];
    const double v1 = state[1];
    const double q2 = state[2];
    const double v2 = state[3];
    const double q3 = state[4];
    const double v3 = state[5];
    const double u2 = input[1];
    const double y1 = observer_state[0];
    const double y2 = observer_state[1];
    const double z1 = observer_state[2];
    const double z2 = observer_state[3];
    const double z3 = observer_state[4];
    const double w1 = observer_state[5];
    const double w2 = observer_state[6];
    const double w3 = observer_state[7];
    const double c1 = gain[0];
    const double c2 = gain[1];
    const double c3 = gain[2];
    const double width = constant[0];
    estimate[0] = y1 - c1*v1*(q1 - q2);
    estimate[1] = y2 - c1*width*(log(1 + exp(-2*fabs(v1/width))) + fabs(v1/width) - log(2));
    estimate[2] = z1 + c2*v2*(q1 - q2);
    estimate[3] = z2 - c2*v2*(q2 - q3);
    estimate[4] = z3 - 1.0/4.0*c2*(v2*v2*v2*v2);
    estimate[5] = w1 + c3*v3*(q2 - q3);
    estimate[6] = w2 - 1.0/3.0*c3*(v3*v3*v3)*sin(q3);
    estimate[7] = w3 + c3*u2*v3*cos(q1);
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
    const double q1 = state[0];
    const double v1 = state[1];
    const double q2 = state[2];
    const double v2 = state[3];
    const double q3 = state[4];
    const double v3 = state[5];
    const double u1 = input[0];
    const double u2 = input[1];
    const double u2_rate = input_rate[1];
    const double y1 = observer_state[0];
    const double y2 = observer_state[1];
    const double z1 = observer_state[2];
    const double z2 = observer_state[3];
    const double z3 = observer_state[4];
    const double w1 = observer_state[5];
    const double w2 = observer_state[6];
    const double w3 = observer_state[7];
    const double c1 = gain[0];
    const double c2 = gain[1];
    const double c3 = gain[2];
    const double width = constant[0];
    const double a1_hat = y1 - c1*v1*(q1 - q2);
    const double a2_hat = y2 - c1*width*(log(1 + exp(-2*fabs(v1/width))) + fabs(v1/width) - log(2));
    const double b1_hat = z1 + c2*v2*(q1 - q2);
    const double b2_hat = z2 - c2*v2*(q2 - q3);
    const double b3_hat = z3 - 1.0/4.0*c2*(v2*v2*v2*v2);
    const double d1_hat = w1 + c3*v3*(q2 - q3);
    const double d2_hat = w2 - 1.0/3.0*c3*(v3*v3*v3)*sin(q3);
    const double d3_hat = w3 + c3*u2*v3*cos(q1);
    const double s = -a1_hat*(q1 - q2) - a2_hat*tanh(v1/width) + u1;
    const double r = b1_hat*(q1 - q2) - b2_hat*(q2 - q3) - b3_hat*(v2*v2*v2);
    const double s3 = d1_hat*(q2 - q3) - d2_hat*(v3*v3)*sin(q3) + d3_hat*u2*cos(q1);
    rate[0] = -c1*(-s*(q1 - q2) - v1*(v1 - v2));
    rate[1] = c1*s*tanh(v1/width);
    rate[2] = -c2*(r*(q1 - q2) + v2*(v1 - v2));
    rate[3] = -c2*(-r*(q2 - q3) - v2*(v2 - v3));
    rate[4] = c2*r*(v2*v2*v2);
    rate[5] = -c3*(s3*(q2 - q3) + v3*(v2 - v3));
    rate[6] = -c3*(-s3*(v3*v3)*sin(q3) - 1.0/3.0*(v3*v3*v3*v3)*cos(q3));
    rate[7] = -c3*(s3*u2*cos(q1) - v3*(u2*v1*sin(q1) - u2_rate*cos(q1)));
}
