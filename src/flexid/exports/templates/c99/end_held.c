    uint32_t input = MIDDLE; /* inputs are held until the next sample */
    if (state->samples > ((2U * HALF_WINDOW) + 1U)) {
        --input;
    }
    sampled_parts(x, &state->window[input][FLEXID_ROWS], end);
