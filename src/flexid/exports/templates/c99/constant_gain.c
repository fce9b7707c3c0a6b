
/* ---- The observer with constant gain, eqs. (2)-(3), sampled --------------------------------- */

void flexid_init(flexid_state *state)
{
    static const flexid_real start[FLEXID_COEFFICIENTS] = {
%% for name in drive.system.coefficients
        {{ drive.start[name] | real }}{{ "" if loop.last else "," }} /* {{ (name ~ ", " ~ drive.unit(name)) | comment }} */
%% endfor
    };
    state->version = FLEXID_VERSION;
    state->health = (uint32_t)FLEXID_CONVERGING;
    state->samples = 0U;
    state->spare = 0U;
    for (uint32_t i = 0U; i < FLEXID_COEFFICIENTS; ++i) {
        state->value[i] = start[i];
    }
    clear(state->before, FLEXID_SIGNALS);
    clear(state->innovation, FLEXID_ROWS);
    clear(state->convergence_rate, FLEXID_ROWS);
    clear(state->latest, FLEXID_SAMPLE_SIZE);
}

void flexid_gap(flexid_state *state)
{
    state->samples = 0U;
}

/* Bring one row's estimates over the interval: p' = G r (v' - r^T p - k), with the regressor of
 * the middle of the interval. Along G r the error decays by exp(-s), s = h r^T G r; that is
 * replaced by 1/(1 + s + s^2/2), which stays between 0 and 1 for any s. */
static void update_row(
    flexid_state *state, uint32_t j, const flexid_real end[], flexid_real velocity)
{
    static const uint32_t row_start[FLEXID_ROWS + 1U] = { {{- drive.row_starts | map("unsigned") | join(", ") -}} };
    static const flexid_real gain[FLEXID_COEFFICIENTS] = { /* G: the paper's c1 and c2 */
%% for name in drive.system.coefficients
        {{ drive.twin.gains[loop.index0] | real }}{{ "" if loop.last else "," }} /* of {{ name | comment }} */
%% endfor
    };
    flexid_real rate = REAL(0.0);
    flexid_real predicted = REAL(0.5) * (state->before[FLEXID_COEFFICIENTS + j] +
                                         end[FLEXID_COEFFICIENTS + j]);
    for (uint32_t i = row_start[j]; i < row_start[j + 1U]; ++i) {
        const flexid_real middle = REAL(0.5) * (state->before[i] + end[i]);
        rate += gain[i] * middle * middle;
        predicted += middle * state->value[i];
    }
    const flexid_real s = SAMPLE_TIME * rate;
    const flexid_real innovation = (velocity - state->latest[(2U * j) + 1U]) - (SAMPLE_TIME * predicted);
    const flexid_real correction = innovation * (REAL(1.0) + (REAL(0.5) * s)) /
                                   (REAL(1.0) + (s * (REAL(1.0) + (REAL(0.5) * s))));
    for (uint32_t i = row_start[j]; i < row_start[j + 1U]; ++i) {
        const flexid_real middle = REAL(0.5) * (state->before[i] + end[i]);
        state->value[i] += gain[i] * middle * correction;
    }
    state->innovation[j] = innovation;
    state->convergence_rate[j] += RECENT * (rate - state->convergence_rate[j]);
}

/* Whether the estimates are numbers, and none overflows. */
static bool is_sound(const flexid_state *state)
{
    bool sound = true;
    for (uint32_t i = 0U; i < FLEXID_COEFFICIENTS; ++i) {
        sound = sound && (FABS(state->value[i]) <= LARGEST_POWER);
    }
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        sound = sound && (FABS(state->convergence_rate[j]) <= LARGEST_POWER) &&
                (FABS(state->innovation[j]) <= LARGEST_POWER);
    }
    return sound;
}

/* A constant gain cannot know that it has converged; it knows how fast it would at best. */
static flexid_health update(flexid_state *state, const flexid_real latest[])
{
    flexid_real end[FLEXID_SIGNALS];
    flexid_health health = FLEXID_CONVERGING;
    sampled_parts(latest, &{{ drive.held_input }}[2U * FLEXID_ROWS], end);
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        update_row(state, j, end, latest[(2U * j) + 1U]);
        if (state->convergence_rate[j] < SLOWEST) {
            health = FLEXID_NOT_EXCITED;
        }
    }
    if (!is_sound(state)) {
        flexid_init(state);
        health = FLEXID_SENSOR_FAULT;
    }
    return health;
}

static flexid_health take_in(flexid_state *state, const flexid_real latest[])
{
    const flexid_health health =
        (state->samples > 0U) ? update(state, latest) : FLEXID_CONVERGING;
    state->samples = 1U;
    sampled_parts(latest, &latest[2U * FLEXID_ROWS], state->before);
    for (uint32_t j = 0U; j < FLEXID_SAMPLE_SIZE; ++j) {
        state->latest[j] = latest[j];
    }
    return health;
}

