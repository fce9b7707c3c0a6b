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
    flexid_real innovation;               /* y - r^T p before the last update, rad/s^2 */
    flexid_real recent_error;             /* mean of innovation^2, lately */
    flexid_real recent_power;             /* mean of y^2, lately */
} flexid_row;
