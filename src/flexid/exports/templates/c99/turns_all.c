/* Whether a row is solved in this step: every one. */
static bool is_turn_of(const flexid_state *state, uint32_t j)
{
    (void)state;
    (void)j;
    return true;
}
