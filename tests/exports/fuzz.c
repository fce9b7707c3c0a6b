/* Arbitrary bytes as samples, gaps and power cycles: no crash, and finite estimates. */
#include "flexid_drive.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const unsigned char *data, size_t size);

static void demand(bool holds)
{
    if (!holds) {
        abort();
    }
}

static bool is_number(flexid_real x)
{
    return (x - x) == (flexid_real)0;
}

static void check(const flexid_state *state, flexid_health health)
{
    flexid_values values;
    flexid_real found[FLEXID_COEFFICIENTS];
    demand((health >= FLEXID_CONVERGING) && (health <= FLEXID_SENSOR_FAULT));
    demand(state->health == (uint32_t)health);
    demand(sizeof values == sizeof found);
    flexid_estimates(state, &values);
    memcpy(found, &values, sizeof found);
    for (unsigned i = 0U; i < FLEXID_COEFFICIENTS; ++i) {
        demand(is_number(found[i]));
    }
}

/* Before a sample: missing samples, a power cycle, a damaged state, or nothing. */
static void disturb(flexid_state *state, unsigned char what)
{
    if (what == 0xFFU) {
        flexid_gap(state);
    } else if (what == 0xFEU) {
        const flexid_state saved = *state;
        *state = saved;
        demand(flexid_restore(state, flexid_checksum(&saved)));
    } else if (what == 0xFDU) {
        demand(!flexid_restore(state, flexid_checksum(state) ^ 1U));
    } else {
        /* nothing */
    }
}

int LLVMFuzzerTestOneInput(const unsigned char *data, size_t size)
{
    static flexid_state state;
    flexid_sample sample;
    flexid_init(&state);
    while (size > sizeof sample) {
        disturb(&state, data[0]);
        memcpy(&sample, &data[1], sizeof sample);
        data += 1U + sizeof sample;
        size -= 1U + sizeof sample;
        /* Each sample is repeated, so that a sequence outlasts the filter's memory. */
        for (unsigned n = 0U; n < 5U; ++n) {
            check(&state, flexid_step(&state, &sample));
        }
    }
    return 0;
}
