/* All that is kept from one sample to the next. A copy of it is a saved estimation; there is no
 * padding in it. */
typedef struct {
    uint32_t version; /* FLEXID_VERSION */
    uint32_t health;  /* flexid_health of the last sample */
    uint32_t samples; /* since the last gap, at most 1 */
    uint32_t spare;   /* 0 */
    flexid_real value[FLEXID_COEFFICIENTS];    /* the estimates */
    flexid_real before[FLEXID_SIGNALS];        /* signals at the last sample */
    flexid_real latest[FLEXID_SAMPLE_SIZE];    /* the last sample */
    flexid_real innovation[FLEXID_ROWS];       /* measured less predicted change of velocity */
    flexid_real convergence_rate[FLEXID_ROWS]; /* mean of r^T G r, lately, in 1/s */
} flexid_state;
