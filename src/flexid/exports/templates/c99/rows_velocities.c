
/* ---- Equations from measured velocities ---------------------------------------------------- */

/* Restart, as before the first sample. */
static void forget_samples(flexid_state *state)
{
    state->samples = 0U;
}

/* As if nothing had ever been sampled. */
static void clear_samples(flexid_state *state)
{
    clear(state->before, FLEXID_SIGNALS);
    clear(state->signal, FLEXID_SIGNALS);
    clear(state->latest, FLEXID_SAMPLE_SIZE);
}

/* Take in one sample; return whether there are equations: regressors, then left-hand sides, in
 * state->signal.
 *
 * The increment of each velocity over the interval, per second, against the regressor's mean over
 * it: the Stieltjes integral of r dv, eqs. (2)-(3), which needs no acceleration. */
static bool next_equations(flexid_state *state, const flexid_real latest[])
{
    flexid_real *const signal = state->signal;
    const bool there = state->samples > 0U;
    state->samples = 1U;
    if (there) {
        sampled_parts(latest, &{{ drive.held_input }}[2U * FLEXID_ROWS], signal);
        for (uint32_t i = 0U; i < FLEXID_COEFFICIENTS; ++i) {
            signal[i] = REAL(0.5) * (state->before[i] + signal[i]);
        }
        for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
            const uint32_t i = FLEXID_COEFFICIENTS + j;
            const flexid_real known = REAL(0.5) * (state->before[i] + signal[i]);
            const flexid_real change = latest[(2U * j) + 1U] - state->latest[(2U * j) + 1U];
            signal[i] = (change / SAMPLE_TIME) - known;
        }
    }
    sampled_parts(latest, &latest[2U * FLEXID_ROWS], state->before);
    for (uint32_t j = 0U; j < FLEXID_SAMPLE_SIZE; ++j) {
        state->latest[j] = latest[j];
    }
    return there;
}

static void before_equations(flexid_state *state)
{
    (void)state;
}

static void after_equations(flexid_state *state)
{
    (void)state;
}

{% include "c99/turns.c" %}
static uint32_t regressors_of(
    const flexid_state *state, uint32_t j, flexid_real regressor[])
{
    const uint32_t n = ROW_START[j + 1U] - ROW_START[j];
    for (uint32_t i = 0U; i < n; ++i) {
        regressor[i] = state->signal[ROW_START[j] + i];
    }
    return n;
}

/* The left-hand side of a row. */
static flexid_real target_of(const flexid_state *state, uint32_t j)
{
    return state->signal[FLEXID_COEFFICIENTS + j];
}

void flexid_gap(flexid_state *state)
{
    forget_samples(state);
}
