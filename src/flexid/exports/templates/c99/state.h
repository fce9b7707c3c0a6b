#define FLEXID_TRIANGLE ((FLEXID_WIDTH * (FLEXID_WIDTH + 1U)) / 2U)

/* A sum, with what rounding took from it so far: what makes a float of years of samples. */
typedef struct {
    flexid_real sum;
    flexid_real lost;
} flexid_total;

/* Least squares of one row, eq. (1): v' = r^T p + k. */
typedef struct {
    uint32_t turn;                        /* the coefficient that was looked at last */
    uint32_t clear;                       /* bit by coefficient: the data determine it */
    flexid_total matrix[FLEXID_TRIANGLE]; /* A, the faded sum of r r^T: lower triangle by rows */
    flexid_total vector[FLEXID_WIDTH];    /* b, the faded sum of r y */
    flexid_real unknown[FLEXID_WIDTH];    /* p, and what came before the first sample */
    flexid_real peak[FLEXID_WIDTH];       /* the largest that A[i][i] has been */
    flexid_real power;                    /* the faded sum of y^2 */
    flexid_real explained;                /* the part of it that the row explains */
    flexid_real innovation;               /* y - r^T p before the last update */
    flexid_real recent_error;             /* mean of innovation^2, lately */
    flexid_real recent_power;             /* mean of y^2, lately */
} flexid_row;

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
