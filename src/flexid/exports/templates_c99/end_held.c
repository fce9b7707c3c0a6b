    const bool held = state->samples > ((2U * HALF_WINDOW) + 1U);
    const uint32_t input = held ? (MIDDLE - 1U) : MIDDLE; /* inputs are held until the next */
    sampled_parts(x, &state->window[input][FLEXID_ROWS], end);
