/* Runs the exported floats on a Cortex-M4F: instructions per call by SysTick (QEMU counts one nanosecond for each), stack by paint. */
#include <stdint.h>
#include "model.h"

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;
void reset(void);
static void hang(void) { for (;;) { } }
__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (void *)reset, (void *)hang, (void *)hang, (void *)hang, (void *)hang, (void *)hang,
};

static void semihost(uint32_t what, const void *with)
{
    register uint32_t r0 __asm__("r0") = what;
    register const void *r1 __asm__("r1") = with;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void say(const char *name, uint32_t value)
{
    static char text[64];
    char digits[12];
    int n = 0, k = 0;
    while (*name) { text[k++] = *name++; }
    text[k++] = ' ';
    do { digits[n++] = (char)('0' + value % 10); value /= 10; } while (value);
    while (n) { text[k++] = digits[--n]; }
    text[k++] = '\n';
    text[k] = 0;
    semihost(0x04, text); /* SYS_WRITE0 */
}

#define CALLS 200
#define PAINTED 8192
static float q[JOINTS], qd[JOINTS], qdd[JOINTS], tau[JOINTS];

static void many(void)
{
    int call, k;
    for (call = 0; call < CALLS; ++call) {
        for (k = 0; k < JOINTS; ++k) {
            q[k] = MIDDLE + 0.002f * (float)(call + 7 * k);
            qd[k] = 0.1f - 0.001f * (float)call;
            qdd[k] = 0.2f;
        }
        INVERSE_DYNAMICS(q, qd, qdd, 0.0f, tau);
    }
}

__attribute__((noinline)) static void measure(void)
{
    volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010u;
    uint8_t *const here = (uint8_t *)__builtin_frame_address(0) - 64;
    uint32_t before, after, k;
    for (k = 0; k < PAINTED; ++k) { ((volatile uint8_t *)here)[-(int32_t)k - 1] = 0xA5; }
    systick[1] = 0xFFFFFFu;
    systick[2] = 0;
    systick[0] = 5; /* enabled, processor clock: 25 MHz */
    before = systick[2];
    many();
    after = systick[2];
    for (k = PAINTED; k > 0 && here[-(int32_t)k] == 0xA5; --k) { }
    say("instructions", (uint32_t)(((before - after) & 0xFFFFFFu) * 40ull / CALLS));
    say("stack", k + 64);
    for (k = 0; k < JOINTS; ++k) { union { float f; uint32_t u; } as = {tau[k]}; say("tau", as.u); }
}

void reset(void)
{
    uint32_t *from = &data_load, *to;
    static const uint32_t ended = 0x20026; /* ADP_Stopped_ApplicationExit */
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* the floating point unit */
    __asm__ volatile("dsb\n isb");
    for (to = &data_start; to < &data_end;) { *to++ = *from++; }
    for (to = &bss_start; to < &bss_end;) { *to++ = 0; }
    measure();
    semihost(0x18, (const void *)ended);
    hang();
}
