/* Reset of a Cortex-M4F on QEMU's mps2-an386: floating point on, then the C library's start. */
#include <stdint.h>

extern uint32_t stack_top;
extern void _start(void);
void reset(void);

void reset(void)
{
    volatile uint32_t *const access = (volatile uint32_t *)0xE000ED88UL; /* CPACR */
    *access |= 0xFUL << 20U;
    __asm__ volatile("dsb\n isb");
    _start();
}

static void fault(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))(uintptr_t)&stack_top, reset, fault, fault, fault, fault, fault,
};
