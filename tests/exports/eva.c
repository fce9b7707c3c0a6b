/* Program for Frama-C's Eva: every call, with arbitrary bytes in the state and the samples. */
#include "__fc_builtin.h"
#include "flexid_drive.h"

int main(void)
{
    flexid_state state;
    flexid_sample sample;
    flexid_values values;
    Frama_C_make_unknown((char *)&state, sizeof state);
    Frama_C_make_unknown((char *)&sample, sizeof sample);
    switch (Frama_C_interval(0, 4)) {
    case 0:
        flexid_init(&state);
        break;
    case 1:
        flexid_gap(&state);
        break;
    case 2:
        flexid_estimates(&state, &values);
        break;
    case 3:
        (void)flexid_restore(&state, (uint32_t)Frama_C_interval(0, 1));
        break;
    default:
        (void)flexid_step(&state, &sample);
        break;
    }
    return 0;
}
