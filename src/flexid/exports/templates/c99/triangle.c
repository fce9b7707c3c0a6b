
/* Where the coefficients of each row begin, and where the last ones end. */
static const uint32_t ROW_START[FLEXID_ROWS + 1U] = { {{- drive.row_starts | map("unsigned") | join(", ") -}} };

static flexid_real larger(flexid_real a, flexid_real b)
{
    return (a > b) ? a : b;
}

/* Place of row i, column k <= i, in a triangle that is stored row by row. */
static uint32_t at(uint32_t i, uint32_t k)
{
    return ((i * (i + 1U)) / 2U) + k;
}
