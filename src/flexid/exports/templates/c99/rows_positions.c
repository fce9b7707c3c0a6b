
/* ---- Equations from positions ------------------------------------------------------------- */

/* Reset the filter to its state before the first sample. */
static void forget_samples(flexid_state *state)
{
    state->samples = 0U;
    state->equations = 0U;
    state->past_gone = 0U;
    state->decayed = REAL(1.0);
    clear(state->once, FLEXID_SIGNALS);
    clear(state->twice, FLEXID_SIGNALS);
}

/* Clear all samples. */
static void clear_samples(flexid_state *state)
{
    for (uint32_t i = 0U; i < FLEXID_WINDOW; ++i) {
        for (uint32_t j = 0U; j < FLEXID_SAMPLE_SIZE; ++j) {
            state->window[i][j] = REAL(0.0);
        }
    }
    clear(state->before, FLEXID_SIGNALS);
    clear(state->long_before, FLEXID_SIGNALS);
    clear(state->end_before, FLEXID_SIGNALS);
}

/* Append the latest sample and drop the oldest. */
static void shift_window(flexid_state *state, const flexid_real latest[])
{
    for (uint32_t i = 0U; i < (FLEXID_WINDOW - 1U); ++i) {
        for (uint32_t j = 0U; j < FLEXID_SAMPLE_SIZE; ++j) {
            state->window[i][j] = state->window[i + 1U][j];
        }
    }
    for (uint32_t j = 0U; j < FLEXID_SAMPLE_SIZE; ++j) {
        state->window[FLEXID_WINDOW - 1U][j] = latest[j];
    }
    if (state->samples < FLEXID_WINDOW) {
        ++state->samples;
    }
}

%% if law.half_window
/* Coordinates and velocities at the middle of the window. */
static void middle_state(const flexid_state *state, flexid_real x[])
{
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        x[2U * j] = state->window[MIDDLE][j];
        flexid_real slope = REAL(0.0); /* of a straight line through the positions */
        for (uint32_t i = 1U; i <= HALF_WINDOW; ++i) {
            slope +=
                (flexid_real)i * (state->window[MIDDLE + i][j] - state->window[MIDDLE - i][j]);
        }
        x[(2U * j) + 1U] = SAMPLES_PER_SECOND * slope / SLOPE_WEIGHT;
    }
}
%% else
/* Coordinates at the middle of the window; no regressor needs velocities. */
static void middle_state(const flexid_state *state, flexid_real x[])
{
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        x[2U * j] = state->window[MIDDLE][j];
        x[(2U * j) + 1U] = REAL(0.0);
    }
}
{% endif %}
/* Signals at the middle of the window: now, and at the end of the interval before it. */
static void signals_of(const flexid_state *state, flexid_real now[], flexid_real end[])
{
    flexid_real x[2U * FLEXID_ROWS];
    middle_state(state, x);
    sampled_parts(x, &state->window[MIDDLE][FLEXID_ROWS], now);
%% if settings.hold == "zero"
    uint32_t input = MIDDLE; /* inputs are held until the next sample */
    if (state->samples > ((2U * HALF_WINDOW) + 1U)) {
        --input;
    }
    sampled_parts(x, &state->window[input][FLEXID_ROWS], end);
%% else
    for (uint32_t i = 0U; i < FLEXID_SIGNALS; ++i) { /* inputs are interpolated linearly */
        end[i] = now[i];
    }
%% endif
}

/* The mean of a signal over the last two intervals, weighted by a triangle. */
static flexid_real triangle_mean(
    const flexid_state *state, uint32_t i, const flexid_real now[], const flexid_real end[])
{
    /* Signals that contain a held input. */
    static const bool held[FLEXID_SIGNALS] = { {{- drive.functions.held | map("boolean") | join(", ") -}} };
    flexid_real mean;
    if (held[i]) {
        const flexid_real inner = state->end_before[i] + state->before[i];
        mean = REAL(1.0) / REAL(6.0) * (state->long_before[i] + (REAL(2.0) * inner) + end[i]);
    } else {
        mean = REAL(1.0) / REAL(12.0) *
               (state->long_before[i] + (REAL(10.0) * state->before[i]) + now[i]);
    }
    return mean;
}

/* Both sides of every row over the last two intervals: regressors, then left-hand sides. */
static void both_sides(
    const flexid_state *state, const flexid_real now[], const flexid_real end[],
    flexid_real side[])
{
    flexid_real velocity[FLEXID_ROWS];
    for (uint32_t i = 0U; i < FLEXID_SIGNALS; ++i) {
        side[i] = triangle_mean(state, i, now, end);
    }
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        velocity[j] = REAL(0.5) * SAMPLES_PER_SECOND *
                      (state->window[MIDDLE][j] - state->window[MIDDLE - 2U][j]);
    }
    add_velocity_parts(velocity, side);
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        const flexid_real change = state->window[MIDDLE][j] - state->window[MIDDLE - 1U][j];
        const flexid_real change_before =
            state->window[MIDDLE - 1U][j] - state->window[MIDDLE - 2U][j];
        const uint32_t i = FLEXID_COEFFICIENTS + j;
        side[i] = (SAMPLES_PER_SECOND * SAMPLES_PER_SECOND * (change - change_before)) - side[i];
    }
}

/* Add a sample; return whether state->twice has new equations: regressors, then left-hand
 * sides. */
static bool next_equations(flexid_state *state, const flexid_real latest[])
{
    flexid_real now[FLEXID_SIGNALS];
    flexid_real end[FLEXID_SIGNALS];
    flexid_real side[FLEXID_SIGNALS];
    shift_window(state, latest);
    const bool there = state->samples >= FLEXID_WINDOW;
    if (state->samples > (2U * HALF_WINDOW)) {
        signals_of(state, now, end);
        if (there) {
            both_sides(state, now, end, side);
        }
        for (uint32_t i = 0U; i < FLEXID_SIGNALS; ++i) {
            if (there) { /* the filter lambda^2/(s + lambda)^2 */
                state->once[i] = (POLE * state->once[i]) + (ONE_LESS_POLE * side[i]);
                state->twice[i] = (POLE * state->twice[i]) + (ONE_LESS_POLE * state->once[i]);
            }
            state->long_before[i] = state->before[i];
            state->before[i] = now[i];
            state->end_before[i] = end[i];
        }
    }
    return there;
}

/* Eliminate an unknown of the filter's initial state from the normal equations. */
static void eliminate(flexid_row *row, uint32_t n, uint32_t q)
{
    const flexid_real pivot = row->matrix[at(q, q)].sum;
    if (pivot > (LEAST_PIVOT * row->matrix[at(n, n)].sum)) {
        row->power -= row->vector[q].sum * row->vector[q].sum / pivot;
        for (uint32_t i = 0U; i < q; ++i) {
            const flexid_real part = row->matrix[at(q, i)].sum / pivot;
            row->vector[i].sum -= part * row->vector[q].sum;
            for (uint32_t k = 0U; k <= i; ++k) {
                row->matrix[at(i, k)].sum -= part * row->matrix[at(q, k)].sum;
            }
        }
    }
    row->unknown[q] = REAL(0.0);
    row->vector[q].sum = REAL(0.0);
    row->vector[q].lost = REAL(0.0);
    for (uint32_t i = 0U; i <= q; ++i) {
        row->matrix[at(q, i)].sum = REAL(0.0);
        row->matrix[at(q, i)].lost = REAL(0.0);
    }
}

/* Eliminate the filter's initial state from all rows, after it has decayed or before a gap. */
static void forget_past(flexid_state *state)
{
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        const uint32_t n = ROW_START[j + 1U] - ROW_START[j];
        eliminate(&state->row[j], n, n + 1U);
        eliminate(&state->row[j], n, n);
    }
    state->past_gone = 1U;
}

static void before_equations(flexid_state *state)
{
    if ((state->past_gone == 0U) && (state->equations >= MEMORY)) {
        forget_past(state);
    }
}

static void after_equations(flexid_state *state)
{
    if (state->equations < MEMORY) {
        state->decayed *= POLE;
        ++state->equations;
    }
}

{% include "c99/turns.c" %}
/* Regressors of a row, with z^i and i z^i until the filter's initial state has decayed. */
static uint32_t regressors_of(
    const flexid_state *state, uint32_t j, flexid_real regressor[])
{
    const uint32_t n = ROW_START[j + 1U] - ROW_START[j];
    uint32_t m = n;
    for (uint32_t i = 0U; i < n; ++i) {
        regressor[i] = state->twice[ROW_START[j] + i];
    }
    if (state->past_gone == 0U) {
        regressor[n] = state->decayed;
        regressor[n + 1U] = (flexid_real)state->equations * state->decayed;
        m = n + 2U;
    }
    return m;
}

/* The left-hand side of a row. */
static flexid_real target_of(const flexid_state *state, uint32_t j)
{
    return state->twice[FLEXID_COEFFICIENTS + j];
}

void flexid_gap(flexid_state *state)
{
    if ((state->past_gone == 0U) && (state->equations > 0U)) {
        forget_past(state);
    }
    forget_samples(state);
}
