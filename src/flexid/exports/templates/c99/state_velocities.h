/* All that is kept from one sample to the next. A copy of it is a saved estimation; there is no
 * padding in it. */
typedef struct {
    uint32_t version; /* FLEXID_VERSION */
    uint32_t health;  /* flexid_health of the last sample */
    uint32_t samples; /* since the last gap, at most 1 */
    uint32_t clock;   /* equations ever, at most PATIENCE */
    flexid_real before[FLEXID_SIGNALS];        /* signals at the last sample */
    flexid_real signal[FLEXID_SIGNALS];        /* regressors, then left-hand sides */
    flexid_real latest[FLEXID_SAMPLE_SIZE];    /* the last sample */
    flexid_real weight;                        /* the faded number of equations */
    flexid_row row[FLEXID_ROWS];
} flexid_state;
