/* All that is kept from one sample to the next. A copy of it is a saved estimation; there is no
 * padding in it. */
typedef struct {
    uint32_t version;   /* FLEXID_VERSION */
    uint32_t health;    /* flexid_health of the last sample */
    uint32_t samples;   /* since the last gap, at most FLEXID_WINDOW */
    uint32_t equations; /* since the last gap */
    uint32_t clock;     /* equations ever, at most PATIENCE */
    uint32_t past_gone; /* 1 when the filter remembers nothing of what was before the last gap */
    flexid_real window[FLEXID_WINDOW][FLEXID_SAMPLE_SIZE]; /* latest samples, latest last */
    flexid_real before[FLEXID_SIGNALS];      /* signals one sample before */
    flexid_real long_before[FLEXID_SIGNALS]; /* two samples before */
    flexid_real end_before[FLEXID_SIGNALS];  /* one sample before, with the input held until then */
    flexid_real once[FLEXID_SIGNALS];        /* through the filter once */
    flexid_real twice[FLEXID_SIGNALS];       /* and once more */
    flexid_real decayed;                     /* pole^equations */
    flexid_real weight;                      /* the faded number of equations */
    flexid_row row[FLEXID_ROWS];
} flexid_state;
