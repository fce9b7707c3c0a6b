
/* ---- Least squares: A <- mu A + r r^T + (1 - mu) F, b <- mu b + r y + (1 - mu) F p,
 *      p <- p + (A + rho)^-1 (b - A p) -------------------------------------------------------- */

/* A scaled to a unit diagonal, plus the ridge rho, as L L^T. */
typedef struct {
    flexid_real scale[FLEXID_WIDTH];
    flexid_real lower[FLEXID_TRIANGLE];
} factors;

/* sum <- mu sum + more, with what rounding takes kept for the next time (Kahan). */
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
    for (uint32_t i = 0U; i < m; ++i) {
        flexid_real kept = REAL(0.0);
        if (i < n) { /* F: never forgotten, drawn to where the estimate is */
            const flexid_real square = regressor[i] * regressor[i];
            row->peak[i] = larger(row->peak[i], row->matrix[at(i, i)].sum + square);
            kept = KEPT * row->peak[i];
        }
        for (uint32_t k = 0U; k < i; ++k) {
            accumulate(&row->matrix[at(i, k)], regressor[i] * regressor[k]);
        }
        accumulate(&row->matrix[at(i, i)], (regressor[i] * regressor[i]) + kept);
        accumulate(&row->vector[i], (regressor[i] * target) + (kept * row->unknown[i]));
    }
    row->power = (FADING * row->power) + (target * target);
}

/* The entry of L in column k of row i, from those before it; i > k. */
static flexid_real below_diagonal(
    const flexid_row *row, const factors *f, uint32_t i, uint32_t k)
{
    flexid_real total = f->scale[i] * row->matrix[at(i, k)].sum * f->scale[k];
    for (uint32_t q = 0U; q < k; ++q) {
        total -= f->lower[at(i, q)] * f->lower[at(k, q)];
    }
    return total / f->lower[at(k, k)];
}

static void factorise(const flexid_row *row, uint32_t m, factors *f)
{
    for (uint32_t i = 0U; i < m; ++i) {
        const flexid_real diagonal = row->matrix[at(i, i)].sum;
        flexid_real square = REAL(1.0) + RIDGE;
        f->scale[i] = (diagonal > LEAST_DIAGONAL) ? (REAL(1.0) / SQRT(diagonal)) : REAL(0.0);
        for (uint32_t k = 0U; k < i; ++k) {
            const flexid_real entry = below_diagonal(row, f, i, k);
            f->lower[at(i, k)] = entry;
            square -= entry * entry;
        }
        f->lower[at(i, i)] = SQRT(larger(square, LEAST_SQUARE));
    }
}

/* Entry i of A p. */
static flexid_real product(const flexid_row *row, uint32_t m, uint32_t i)
{
    flexid_real total = REAL(0.0);
    for (uint32_t k = 0U; k < m; ++k) {
        total += row->matrix[(k < i) ? at(i, k) : at(k, i)].sum * row->unknown[k];
    }
    return total;
}

/* p <- p + (A + rho)^-1 (b - A p). The ridge holds directions that the data leave open. */
static void improve(flexid_row *row, uint32_t m, const factors *f)
{
    flexid_real step[FLEXID_WIDTH];
    for (uint32_t i = 0U; i < m; ++i) {
        flexid_real total = (row->vector[i].sum - product(row, m, i)) * f->scale[i];
        for (uint32_t k = 0U; k < i; ++k) {
            total -= f->lower[at(i, k)] * step[k];
        }
        step[i] = total / f->lower[at(i, i)];
    }
    for (uint32_t down = m; down > 0U; --down) {
        const uint32_t i = down - 1U;
        flexid_real total = step[i];
        for (uint32_t k = down; k < m; ++k) {
            total -= f->lower[at(k, i)] * step[k];
        }
        step[i] = total / f->lower[at(i, i)];
    }
    for (uint32_t i = 0U; i < m; ++i) {
        row->unknown[i] += f->scale[i] * step[i];
    }
}

/* The part of regressor i's square that the others do not explain. */
static flexid_real tolerance(const factors *f, uint32_t m, uint32_t i)
{
    flexid_real column[FLEXID_WIDTH];
    flexid_real square = REAL(0.0);
    for (uint32_t j = i; j < m; ++j) {
        flexid_real total = (j == i) ? REAL(1.0) : REAL(0.0);
        for (uint32_t k = i; k < j; ++k) {
            total -= f->lower[at(j, k)] * column[k];
        }
        column[j] = total / f->lower[at(j, j)];
        square += column[j] * column[j];
    }
    return REAL(1.0) / square;
}

/* Whether the data leave none of a row's coefficients open, and the row explains its left side. */
static bool is_determined(flexid_row *row, uint32_t n, uint32_t m, const factors *f)
{
    bool determined = true;
    row->explained = REAL(0.0);
    for (uint32_t i = 0U; i < m; ++i) {
        row->explained += row->unknown[i] * ((REAL(2.0) * row->vector[i].sum) - product(row, m, i));
    }
    for (uint32_t i = 0U; i < n; ++i) {
        determined =
            determined && (f->scale[i] > REAL(0.0)) && (tolerance(f, m, i) > LEAST_TOLERANCE);
    }
    return determined && (row->explained > (LEAST_EXPLAINED * row->power));
}

/* Take in one equation of a row; return whether its coefficients are determined. */
static bool update_row(
    flexid_row *row, uint32_t n, uint32_t m, const flexid_real regressor[], flexid_real target)
{
    factors f;
    flexid_real innovation = target;
    for (uint32_t i = 0U; i < m; ++i) {
        innovation -= regressor[i] * row->unknown[i];
    }
    row->innovation = innovation;
    add_equation(row, n, m, regressor, target);
    factorise(row, m, &f);
    improve(row, m, &f);
    return is_determined(row, n, m, &f);
}

/* ---- Health and the step ------------------------------------------------------------------- */

/* Whether a row's latest equations contradict what it has learnt: of a motion that is not much
 * smaller than usual, they leave more unexplained than a part of it, and than is usual. */
static bool is_contradicted(flexid_row *row, flexid_real target, flexid_real weight)
{
    const flexid_real usual = larger(row->power - row->explained, REAL(0.0));
    const flexid_real allowed = SLACK + (UNUSUAL * usual / larger(row->power, LEAST_DIAGONAL));
    row->recent_error += RECENT * ((row->innovation * row->innovation) - row->recent_error);
    row->recent_power += RECENT * ((target * target) - row->recent_power);
    return (row->recent_power * weight > (STANDSTILL * row->power)) &&
           (row->recent_error > (allowed * row->recent_power));
}

/* Whether every number of a row is one, and none overflows. */
static bool is_sound(const flexid_row *row, uint32_t m)
{
    bool sound = (row->power >= REAL(0.0)) && (row->power <= LARGEST_POWER);
    for (uint32_t i = 0U; i < m; ++i) {
        sound = sound && (FABS(row->unknown[i]) <= LARGEST_POWER) &&
                (row->matrix[at(i, i)].sum <= LARGEST_POWER);
    }
    return sound;
}

void flexid_init(flexid_state *state)
{
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
            row->unknown[i] = (place < ROW_START[j + 1U]) ? START[place] : REAL(0.0);
            row->peak[i] = REAL(0.0);
        }
        row->power = REAL(0.0);
        row->explained = REAL(0.0);
        row->innovation = REAL(0.0);
        row->recent_error = REAL(0.0);
        row->recent_power = REAL(0.0);
    }
    clear_samples(state);
    forget_samples(state);
}

/* All rows take in their equations; what that says of the estimation. */
static flexid_health update(flexid_state *state, const flexid_real signal[])
{
    bool sound = true;
    bool determined = true;
    bool contradicted = false;
    const bool settled = state->clock >= FEWEST;
    flexid_health health = FLEXID_CONVERGED;
    before_equations(state);
    state->weight = (FADING * state->weight) + REAL(1.0);
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        flexid_real regressor[FLEXID_WIDTH];
        flexid_row *const row = &state->row[j];
        const uint32_t n = ROW_START[j + 1U] - ROW_START[j];
        const uint32_t m = regressors_of(state, j, signal, regressor);
        const flexid_real target = signal[FLEXID_COEFFICIENTS + j];
        determined = update_row(row, n, m, regressor, target) && determined;
        if (settled) {
            contradicted = is_contradicted(row, target, state->weight) || contradicted;
        }
        sound = sound && is_sound(row, m);
    }
    after_equations(state);
    if (!sound) {
        flexid_init(state);
        health = FLEXID_SENSOR_FAULT;
    } else if (!settled) {
        ++state->clock;
        health = FLEXID_CONVERGING;
    } else if (!determined) {
        health = FLEXID_NOT_EXCITED;
    } else if (contradicted) {
        health = FLEXID_INCONSISTENT;
    } else {
        /* converged */
    }
    return health;
}

flexid_health flexid_step(flexid_state *state, const flexid_sample *sample)
{
    const flexid_real latest[FLEXID_SAMPLE_SIZE] = {
$latest
    };
    flexid_real signal[FLEXID_SIGNALS];
    flexid_health health = FLEXID_CONVERGING;
    bool usable = true;
    for (uint32_t i = 0U; i < FLEXID_SAMPLE_SIZE; ++i) {
        usable = usable && is_usable(latest[i]);
    }
    if (!usable) {
        flexid_gap(state);
        health = FLEXID_SENSOR_FAULT;
    } else if (next_equations(state, latest, signal)) {
        health = update(state, signal);
    } else {
        /* converging: no equation yet since the beginning or a gap */
    }
    state->health = (uint32_t)health;
    return health;
}

void flexid_estimates(const flexid_state *state, flexid_values *values)
{
$estimates
}
