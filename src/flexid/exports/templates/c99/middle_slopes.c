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
