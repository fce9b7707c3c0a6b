/* Coordinates at the middle of the window; velocities are not needed by themselves. */
static void middle_state(const flexid_state *state, flexid_real x[])
{
    for (uint32_t j = 0U; j < FLEXID_ROWS; ++j) {
        x[2U * j] = state->window[MIDDLE][j];
        x[(2U * j) + 1U] = REAL(0.0);
    }
}
