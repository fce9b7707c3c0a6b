%% if drive.system.rows | length == 1
/* Whether a row is solved in this step; true for a single row. */
static bool is_turn_of(const flexid_state *state, uint32_t j)
{
    (void)state;
    (void)j;
    return true;
}
%% else
/* Whether a row is solved in this step. Until the filter's initial state has decayed, there are two
 * more unknowns. In float the rows then take turns, so that no step takes much longer. */
static bool is_turn_of(const flexid_state *state, uint32_t j)
{
    bool turn = true;
#if defined(FLEXID_FLOAT)
    if (state->past_gone == 0U) {
        turn = ((state->equations + j) % FLEXID_ROWS) == 0U;
    }
#else
    (void)state;
    (void)j;
#endif
    return turn;
}
%% endif
