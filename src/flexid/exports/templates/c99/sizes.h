#define FLEXID_ROWS {{ drive.counts | length }}U
#define FLEXID_COEFFICIENTS {{ drive.counts | sum }}U
#define FLEXID_SIGNALS {{ drive.counts | sum + drive.counts | length }}U
#define FLEXID_SAMPLE_SIZE {{ drive.sample_names | length }}U
#define FLEXID_WIDTH {{ drive.counts | max + 2 }}U
#define FLEXID_WINDOW {{ 2 * law.half_window + 3 }}U
#define FLEXID_LARGEST ((flexid_real){{ largest }}) /* largest number in a sample, in its unit */
