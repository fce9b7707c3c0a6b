#define FLEXID_TRIANGLE ((FLEXID_WIDTH * (FLEXID_WIDTH + 1U)) / 2U)

/* Compensated sum, which keeps a float accurate over years of samples. */
typedef struct {
    flexid_real sum;
    flexid_real lost; /* accumulated rounding error */
} flexid_total;

/* Least squares of one row, eq. (1): v' = r^T p + k. */
typedef struct {
    uint32_t turn;                        /* coefficient that was checked last */
    uint32_t clear;                       /* one bit per coefficient: the data determine it */
    flexid_total matrix[FLEXID_TRIANGLE]; /* A, the weighted sum of r r^T: lower triangle by rows */
    flexid_total vector[FLEXID_WIDTH];    /* b, the weighted sum of r y */
    flexid_real unknown[FLEXID_WIDTH];    /* p, and the filter's initial state */
    flexid_real peak[FLEXID_WIDTH];       /* largest value of A[i][i] so far */
    flexid_real power;                    /* weighted sum of y^2 */
    flexid_real explained;                /* part of it that the row explains */
    flexid_real innovation;               /* y - r^T p before the last update */
    flexid_real recent_error;             /* mean of recent innovation^2 */
    flexid_real recent_power;             /* mean of recent y^2 */
} flexid_row;

/* State of the estimator, without padding. A copy saves the estimation. */
typedef struct {
    uint32_t version;   /* FLEXID_VERSION */
    uint32_t health;    /* flexid_health of the last sample */
    uint32_t samples;   /* since the last gap, at most FLEXID_WINDOW */
    uint32_t equations; /* since the last gap */
    uint32_t clock;     /* all equations, at most PATIENCE */
    uint32_t past_gone; /* 1 if the filter's initial state has decayed */
    flexid_real window[FLEXID_WINDOW][FLEXID_SAMPLE_SIZE]; /* latest samples, latest last */
    flexid_real before[FLEXID_SIGNALS];      /* signals one sample before */
    flexid_real long_before[FLEXID_SIGNALS]; /* two samples before */
    flexid_real end_before[FLEXID_SIGNALS];  /* one sample before, with the input held until then */
    flexid_real once[FLEXID_SIGNALS];        /* output of the first filter stage */
    flexid_real twice[FLEXID_SIGNALS];       /* output of the second filter stage */
    flexid_real decayed;                     /* pole^equations */
    flexid_real weight;                      /* weighted number of equations */
    flexid_row row[FLEXID_ROWS];
} flexid_state;
