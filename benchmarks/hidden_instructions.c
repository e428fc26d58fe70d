/* Hides instruction sets of the processor from one process (Linux, Intel).

   It is preloaded, with DALEMBERT_TARGET=x86-64-v2 or x86-64-v3. The instruction CPUID faults in this process, and the
   handler of the fault answers as a processor of that level does. So every compiler in the process, also that of
   another program, writes code for that level. See benchmarks/lesser_processors.py. */
#define _GNU_SOURCE
#include <cpuid.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <ucontext.h>
#include <unistd.h>

#define BIT(n) (1u << (n))

enum { ARCH_CPUID = 0x1012, EAX = 0, EBX = 1, ECX = 2, EDX = 3, HASWELL = 0x306c3, NEHALEM = 0x106a5 };

static int level;

static void answer(unsigned leaf, unsigned part, unsigned out[4])
{
    syscall(SYS_arch_prctl, ARCH_CPUID, 1);
    __cpuid_count(leaf, part, out[EAX], out[EBX], out[ECX], out[EDX]);
    syscall(SYS_arch_prctl, ARCH_CPUID, 0);
    if (leaf == 1) {
        out[EAX] = level == 3 ? HASWELL : NEHALEM;
        if (level == 2) /* FMA, MOVBE, XSAVE, OSXSAVE, AVX, F16C */
            out[ECX] &= ~(BIT(12) | BIT(22) | BIT(26) | BIT(27) | BIT(28) | BIT(29));
    }
    if (leaf == 7) { /* of the extended features, BMI1, AVX2 and BMI2 alone */
        unsigned kept = part == 0 && level == 3 ? BIT(3) | BIT(5) | BIT(8) : 0;
        out[EAX] = out[ECX] = out[EDX] = 0;
        out[EBX] &= kept;
    }
    if (leaf == 0x80000001 && level == 2) /* LZCNT */
        out[ECX] &= ~BIT(5);
}

static void on_fault(int number, siginfo_t *info, void *context)
{
    greg_t *registers = ((ucontext_t *)context)->uc_mcontext.gregs;
    const unsigned char *code = (const unsigned char *)registers[REG_RIP];
    unsigned out[4];

    (void)info;
    if (code[0] != 0x0f || code[1] != 0xa2) { /* another fault: it happens again, and ends the process */
        signal(number, SIG_DFL);
        return;
    }
    answer((unsigned)registers[REG_RAX], (unsigned)registers[REG_RCX], out);
    registers[REG_RAX] = out[EAX];
    registers[REG_RBX] = out[EBX];
    registers[REG_RCX] = out[ECX];
    registers[REG_RDX] = out[EDX];
    registers[REG_RIP] += 2;
}

__attribute__((constructor)) static void hide(void)
{
    const char *target = getenv("DALEMBERT_TARGET");
    struct sigaction action;

    level = !target ? 0 : !strcmp(target, "x86-64-v2") ? 2 : !strcmp(target, "x86-64-v3") ? 3 : 0;
    if (!level)
        return;
    memset(&action, 0, sizeof action);
    action.sa_sigaction = on_fault;
    action.sa_flags = SA_SIGINFO | SA_NODEFER;
    sigaction(SIGSEGV, &action, NULL);
    if (syscall(SYS_arch_prctl, ARCH_CPUID, 0)) {
        fputs("instructions cannot be hidden here: CPUID does not fault on this processor\n", stderr);
        _exit(3);
    }
}
