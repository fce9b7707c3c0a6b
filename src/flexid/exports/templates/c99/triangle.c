
/* Index of the first coefficient of each row, and the number of all. */
static const uint32_t ROW_START[FLEXID_ROWS + 1U] = { {{- drive.row_starts | map("unsigned") | join(", ") -}} };

static flexid_real larger(flexid_real a, flexid_real b)
{
    return (a > b) ? a : b;
}

/* Index of row i, column k <= i, in a lower triangle stored by rows. */
static uint32_t at(uint32_t i, uint32_t k)
{
    return ((i * (i + 1U)) / 2U) + k;
}
