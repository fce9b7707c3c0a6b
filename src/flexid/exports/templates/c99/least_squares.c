
/* ---- Least squares: A <- mu A + r r^T + (1 - mu) F, b <- mu b + r y + (1 - mu) F p,
 *      p <- p + (A + rho)^-1 (b - A p) -------------------------------------------------------- */

/* Cholesky factor L of A, with the diagonal of A times 1 + rho. */
typedef struct {
    flexid_real lower[FLEXID_TRIANGLE];
    flexid_real inverse[FLEXID_WIDTH]; /* of L's diagonal; 0 for a regressor that was always zero */
} factors;

/* sum <- mu sum + more; the rounding error is added the next time (Kahan). */
static void accumulate(flexid_total *total, flexid_real more)
{
    const flexid_real change = (more - (FORGOTTEN * total->sum)) - total->lost;
    const flexid_real sum = total->sum + change;
    total->lost = (sum - total->sum) - change;
    total->sum = sum;
}

static void add_equation(
    flexid_row *row, uint32_t n, uint32_t m, const flexid_real regressor[], flexid_real target)
{
    uint32_t place = 0U;
    for (uint32_t i = 0U; i < m; ++i) {
        const flexid_real square = regressor[i] * regressor[i];
        flexid_real kept = REAL(0.0);
        for (uint32_t k = 0U; k < i; ++k) {
            accumulate(&row->matrix[place], regressor[i] * regressor[k]);
            ++place;
        }
        if (i < n) { /* F: least information, which keeps the estimate */
            row->peak[i] = larger(row->peak[i], (FADING * row->matrix[place].sum) + square);
            kept = KEPT * row->peak[i];
        }
        accumulate(&row->matrix[place], square + kept);
        ++place;
        accumulate(&row->vector[i], (regressor[i] * target) + (kept * row->unknown[i]));
    }
    row->power = (FADING * row->power) + (target * target);
}

/* total - a b. */
static inline flexid_real less_product(
    flexid_real total, const flexid_real a[], const flexid_real b[], uint32_t n)
{
    flexid_real rest = total;
    for (uint32_t i = 0U; i < n; ++i) {
        rest -= a[i] * b[i];
    }
    return rest;
}

static void factorise(const flexid_row *row, uint32_t m, factors *f)
{
    clear(f->lower, FLEXID_TRIANGLE);
    clear(f->inverse, FLEXID_WIDTH);
    for (uint32_t i = 0U; i < m; ++i) {
        const uint32_t row_i = at(i, 0U);
        const flexid_real diagonal = row->matrix[row_i + i].sum;
        flexid_real *const line = &f->lower[row_i];
        for (uint32_t k = 0U; k < i; ++k) {
            const flexid_real entry = row->matrix[row_i + k].sum;
            line[k] = less_product(entry, line, &f->lower[at(k, 0U)], k) * f->inverse[k];
        }
        if (diagonal > LEAST_DIAGONAL) {
            const flexid_real square =
                less_product(diagonal + (RIDGE * diagonal), line, line, i);
            line[i] = SQRT(larger(square, LEAST_SQUARE * diagonal));
            f->inverse[i] = REAL(1.0) / line[i];
        }
    }
}

/* p <- p + (A + rho)^-1 (b - A p), which is (A + rho)^-1 (b + rho p): the ridge keeps p along
 * directions that the data do not determine. Returns b^T p, the explained part of y^2. */
static flexid_real improve(flexid_row *row, uint32_t m, const factors *f)
{
    flexid_real step[FLEXID_WIDTH];
    flexid_real explained = REAL(0.0);
    clear(step, FLEXID_WIDTH);
    for (uint32_t i = 0U; i < m; ++i) {
        const uint32_t place = at(i, 0U);
        const flexid_real pull = RIDGE * row->matrix[place + i].sum * row->unknown[i];
        const flexid_real total = row->vector[i].sum + pull;
        step[i] = less_product(total, &f->lower[place], step, i) * f->inverse[i];
    }
    for (uint32_t down = m; down > 0U; --down) {
        const uint32_t i = down - 1U;
        const uint32_t place = at(i, 0U);
        step[i] *= f->inverse[i];
        if (f->inverse[i] > REAL(0.0)) {
            row->unknown[i] = step[i];
        }
        explained += row->unknown[i] * row->vector[i].sum;
        for (uint32_t k = 0U; k < i; ++k) {
            step[k] -= f->lower[place + k] * step[i];
        }
    }
    return explained;
}

/* Whether enough of regressor i's square, 1/((A^-1)[i][i]), is independent of the others. */
static bool is_clear(const flexid_row *row, uint32_t m, uint32_t i, const factors *f)
{
    flexid_real column[FLEXID_WIDTH];
    flexid_real square = f->inverse[i] * f->inverse[i];
    const flexid_real allowed = LEAST_TOLERANCE * row->matrix[at(i, i)].sum;
    clear(column, FLEXID_WIDTH);
    column[i] = f->inverse[i];
    for (uint32_t j = i + 1U; j < m; ++j) {
        column[j] = less_product(REAL(0.0), &f->lower[at(j, 0U)], column, j) * f->inverse[j];
        square += column[j] * column[j];
    }
    return (square > REAL(0.0)) && ((square * allowed) < REAL(1.0));
}

/* Check whether the data determine a coefficient of a row; each step checks the next one. */
static void look(flexid_row *row, uint32_t n, uint32_t m, const factors *f)
{
    if (row->turn < (n - 1U)) {
        ++row->turn;
    } else {
        row->turn = 0U;
    }
    const uint32_t bit = (uint32_t)1U << row->turn;
    if (is_clear(row, m, row->turn, f)) {
        row->clear |= bit;
    } else {
        row->clear &= ~bit;
    }
}

/* Whether the data determine all coefficients of a row, and it explains its left-hand side. */
static bool is_determined(const flexid_row *row, uint32_t n)
{
    return (row->clear == (((uint32_t)1U << n) - 1U)) &&
           (row->explained > (LEAST_EXPLAINED * row->power));
}

/* Add an equation to a row, and update the least-squares estimates of the row. */
static void update_row(
    flexid_row *row, uint32_t n, uint32_t m, const flexid_real regressor[], flexid_real target,
    bool solve)
{
    row->innovation = less_product(target, regressor, row->unknown, m);
    add_equation(row, n, m, regressor, target);
    if (solve) {
        factors f;
        factorise(row, m, &f);
        row->explained = improve(row, m, &f);
        look(row, n, m, &f);
    }
}

/* ---- Health and the step ------------------------------------------------------------------- */

/* Whether a row's latest equations contradict its estimates: their residuals exceed an absolute
 * share and the usual share, and the motion is not much smaller than usual. */
static bool is_contradicted(flexid_row *row, flexid_real target, flexid_real weight)
{
    const flexid_real usual = larger(row->power - row->explained, REAL(0.0));
    const flexid_real allowed = SLACK + (UNUSUAL * usual / larger(row->power, LEAST_DIAGONAL));
    row->recent_error += RECENT * ((row->innovation * row->innovation) - row->recent_error);
    row->recent_power += RECENT * ((target * target) - row->recent_power);
    return ((row->recent_power * weight) > (STANDSTILL * row->power)) &&
           (row->recent_error > (allowed * row->recent_power));
}

/* Whether no sum has overflowed; `explained` depends on all sums. */
static bool is_sound(const flexid_row *row)
{
    return (row->power <= LARGEST_POWER) && (FABS(row->explained) <= LARGEST_POWER);
}

void flexid_init(flexid_state *state)
{
    static const flexid_real start[FLEXID_COEFFICIENTS] = {
%% for name in drive.system.coefficients
        {{ drive.start[name] | real }}{{ "" if loop.last else "," }} /* {{ (name ~ ", " ~ drive.unit(name)) | comment }} */
%% endfor
    };
    state->version = FLEXID_VERSION;
    state->health = (uint32_t)FLEXID_CONVERGING;
    state->clock = 0U;
    state->weight = REAL(0.0);
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        flexid_row *const row = &state->row[j];
        for (uint32_t i = 0U; i < FLEXID_WIDTH; ++i) {
            const uint32_t place = ROW_START[j] + i;
            for (uint32_t k = 0U; k <= i; ++k) {
                row->matrix[at(i, k)].sum = REAL(0.0);
                row->matrix[at(i, k)].lost = REAL(0.0);
            }
            row->vector[i].sum = REAL(0.0);
            row->vector[i].lost = REAL(0.0);
            row->unknown[i] = (place < ROW_START[j + 1U]) ? start[place] : REAL(0.0);
            row->peak[i] = REAL(0.0);
        }
        row->turn = 0U;
        row->clear = 0U;
        row->power = REAL(0.0);
        row->explained = REAL(0.0);
        row->innovation = REAL(0.0);
        row->recent_error = REAL(0.0);
        row->recent_power = REAL(0.0);
    }
    clear_samples(state);
    forget_samples(state);
}

/* Restart after an overflow of a sum, which makes the estimates invalid. */
static flexid_health restarted(flexid_state *state)
{
    flexid_init(state);
    return FLEXID_SENSOR_FAULT;
}

static flexid_health judged(flexid_state *state, bool determined, bool contradicted)
{
    flexid_health health = FLEXID_CONVERGED;
    if (state->clock < PATIENCE) {
        ++state->clock;
    }
    if (!determined) {
        health = (state->clock < PATIENCE) ? FLEXID_CONVERGING : FLEXID_NOT_EXCITED;
    } else if (contradicted) {
        health = FLEXID_INCONSISTENT;
    } else {
        /* converged */
    }
    return health;
}

/* Add an equation to each row, and return the health. */
static flexid_health update(flexid_state *state)
{
    bool sound = true;
    bool determined = true;
    bool contradicted = false;
    const bool settled = state->clock >= FEWEST;
    before_equations(state);
    state->weight = (FADING * state->weight) + REAL(1.0);
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        flexid_real regressor[FLEXID_WIDTH];
        clear(regressor, FLEXID_WIDTH);
        flexid_row *const row = &state->row[j];
        const uint32_t n = ROW_START[j + 1U] - ROW_START[j];
        const uint32_t m = regressors_of(state, j, regressor);
        const flexid_real target = target_of(state, j);
        update_row(row, n, m, regressor, target, is_turn_of(state, j));
        determined = is_determined(row, n) && determined;
        if (settled) {
            contradicted = is_contradicted(row, target, state->weight) || contradicted;
        }
        sound = sound && is_sound(row);
    }
    after_equations(state);
    return sound ? judged(state, determined && settled, contradicted) : restarted(state);
}

static flexid_health take_in(flexid_state *state, const flexid_real latest[])
{
    /* Converging until the first equation after the start or a gap. */
    return next_equations(state, latest) ? update(state) : FLEXID_CONVERGING;
}

