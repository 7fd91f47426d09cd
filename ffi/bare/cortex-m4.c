/* Start-up and semihosting for a Cortex-M4F: no libc at all. */
#include <stdint.h>

extern unsigned char bss_start[], bss_end[], stack_top[];
int main(void);
void print(const char *text);
void finish(int status);
void reset(void);

static int semihosting(int operation, const void *argument) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void print(const char *text) { semihosting(0x04, text); }

void finish(int status) {
    /* ADP_Stopped_ApplicationExit, or a run-time error. */
    semihosting(0x18, (const void *)(uintptr_t)(status == 0 ? 0x20026 : 0x20023));
    for (;;) {
    }
}

static void fault(void) {
    print("fault\n");
    finish(4);
}

void reset(void) {
    volatile uint32_t *coprocessors = (volatile uint32_t *)0xE000ED88;
    unsigned char *at;
    *coprocessors |= 0xFu << 20; /* the floating-point unit */
    __asm__ volatile("dsb\nisb");
    for (at = bss_start; at < bss_end; at++) {
        *at = 0;
    }
    main();
    finish(0);
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    stack_top, (const void *)reset, (const void *)fault, (const void *)fault,
    (const void *)fault, (const void *)fault, (const void *)fault,
};
