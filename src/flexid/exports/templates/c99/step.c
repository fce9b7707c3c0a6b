flexid_health flexid_step(flexid_state *state, const flexid_sample *sample)
{
    const flexid_real latest[FLEXID_SAMPLE_SIZE] = {
$latest
    };
    flexid_health health = FLEXID_SENSOR_FAULT;
    bool usable = true;
    for (uint32_t i = 0U; i < FLEXID_SAMPLE_SIZE; ++i) {
        usable = usable && is_usable(latest[i]);
    }
    if (usable) {
        health = take_in(state, latest);
    } else {
        flexid_gap(state);
    }
    state->health = (uint32_t)health;
    return health;
}

void flexid_estimates(const flexid_state *state, flexid_values *values)
{
$estimates
}
