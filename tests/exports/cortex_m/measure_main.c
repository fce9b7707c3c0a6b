/* Counts instructions and stack of a step on QEMU's mps2-an386.
 *
 * Under "-icount shift=10" an instruction takes 1024 ns of the virtual clock, which are 25.6 ticks
 * of SysTick at 25 MHz. Prints: steps, mean and largest count, bytes of stack.
 */
#include <stdint.h>
#include <stdio.h>

#include "flexid_drive.h"

#include "test_vector.h"

#define SYST_CSR (*(volatile uint32_t *)0xE000E010UL)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014UL)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018UL)
#define TICKS_PER_INSTRUCTION 25.6

#define PAINTED 4096U
#define PAINT 0xA5U

static flexid_state state;

flexid_health nothing(flexid_state *s, const flexid_sample *sample);

__attribute__((noinline)) flexid_health nothing(flexid_state *s, const flexid_sample *sample)
{
    (void)s;
    (void)sample;
    return FLEXID_CONVERGING;
}

static uint32_t ticks_of(
    flexid_health (*step)(flexid_state *, const flexid_sample *), const flexid_sample *sample)
{
    const uint32_t before = SYST_CVR;
    (void)step(&state, sample);
    return (before - SYST_CVR) & 0xFFFFFFUL;
}

/* Bytes below this frame to which a step writes. */
__attribute__((noinline)) static unsigned stack_of(const flexid_sample *sample)
{
    volatile unsigned char *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    for (unsigned i = 1U; i <= PAINTED; ++i) {
        top[-(int)i] = PAINT;
    }
    (void)flexid_step(&state, sample);
    unsigned used = PAINTED;
    while ((used > 0U) && (top[-(int)used] == PAINT)) {
        --used;
    }
    return used;
}

int main(void)
{
    double total = 0.0;
    double most = 0.0;
    unsigned stack = 0U;
    SYST_RVR = 0xFFFFFFUL;
    SYST_CVR = 0UL;
    SYST_CSR = 5UL;
    flexid_init(&state);
    (void)ticks_of(nothing, &SAMPLES[0]);
    const uint32_t call = ticks_of(nothing, &SAMPLES[0]);
    for (unsigned n = 0U; n < N_SAMPLES; ++n) {
        const double count = (double)(ticks_of(flexid_step, &SAMPLES[n]) - call) /
                             TICKS_PER_INSTRUCTION;
        total += count;
        most = (count > most) ? count : most;
        if ((n % 100U) == 99U) {
            const flexid_state kept = state;
            const unsigned used = stack_of(&SAMPLES[n]);
            stack = (used > stack) ? used : stack;
            state = kept;
        }
    }
    (void)printf("%u %.0f %.0f %u %u\n", (unsigned)N_SAMPLES, total / (double)N_SAMPLES, most, stack,
                 (unsigned)sizeof(flexid_state));
    return 0;
}
