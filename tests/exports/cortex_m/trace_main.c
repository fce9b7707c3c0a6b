/* Every path of a step, for a trace: the beginning, a gap, faults, overflowing sums, rest. */
#include <math.h>

#include "flexid_drive.h"

#include "test_vector.h"

#define SOME 1400U

static flexid_state state;

static void replay(unsigned from, unsigned to, flexid_real scale)
{
    for (unsigned n = from; n < to; ++n) {
        flexid_sample sample = SAMPLES[n % N_SAMPLES];
        sample.x1 *= scale;
        (void)flexid_step(&state, &sample);
    }
}

int main(void)
{
    flexid_sample bad = SAMPLES[0];
    flexid_init(&state);
    replay(0U, SOME, (flexid_real)1);
    replay(SOME, SOME + 300U, (flexid_real)1.2);
    bad.x1 = (flexid_real)NAN;
    (void)flexid_step(&state, &bad);
    replay(0U, 300U, (flexid_real)1);
    (void)flexid_step(&state, &bad);
    flexid_init(&state);
    for (unsigned n = 0U; n < 200U; ++n) { /* nothing moves */
        (void)flexid_step(&state, &SAMPLES[0]);
    }
    for (unsigned n = 0U; n < 40U; ++n) {
        flexid_sample wild = SAMPLES[n];
        wild.x1 = (((n % 2U) == 0U) ? FLEXID_LARGEST : -FLEXID_LARGEST);
        wild.x3 = -wild.x1;
        (void)flexid_step(&state, &wild);
    }
    return 0;
}
