/* Cost of a bare stop: a syscall that a seccomp filter hands to a tracer, which resumes the thread at once.
 *
 *     cc -O2 -o bare_stop benches/bare_stop.c && ./bare_stop && ./bare_stop switched
 *
 * `switched`: of a thread whose time stamp counter is not readable, as that of a client in lockstep. The kernel
 * switches it each time that another thread runs.
 */
#define _GNU_SOURCE
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define COUNT 200000

static void client(int switched) {
    struct sock_filter code[] = {
        {BPF_LD | BPF_W | BPF_ABS, 0, 0, offsetof(struct seccomp_data, nr)},
        {BPF_JMP | BPF_JEQ | BPF_K, 0, 1, SYS_getppid},
        {BPF_RET | BPF_K, 0, 0, SECCOMP_RET_TRACE},
        {BPF_RET | BPF_K, 0, 0, SECCOMP_RET_ALLOW},
    };
    struct sock_fprog filter = {sizeof code / sizeof *code, code};
    if (switched)
        prctl(PR_SET_TSC, PR_TSC_SIGSEGV);
    ptrace(PTRACE_TRACEME, 0, 0, 0);
    raise(SIGSTOP);
    prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter);
    for (int i = 0; i < COUNT; i++)
        syscall(SYS_getppid);
    _exit(0);
}

int main(int count, char **words) {
    int switched = count > 1 && strcmp(words[1], "switched") == 0;
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    sched_setaffinity(0, sizeof one, &one);
    pid_t pid = fork();
    if (pid == 0)
        client(switched);
    int status;
    waitpid(pid, &status, 0);
    ptrace(PTRACE_SETOPTIONS, pid, 0, PTRACE_O_TRACESECCOMP | PTRACE_O_EXITKILL);
    struct timespec begun, ended;
    clock_gettime(CLOCK_MONOTONIC, &begun);
    do
        ptrace(PTRACE_CONT, pid, 0, 0);
    while (waitpid(pid, &status, __WALL) == pid && WIFSTOPPED(status));
    clock_gettime(CLOCK_MONOTONIC, &ended);
    double took = (ended.tv_sec - begun.tv_sec) * 1e6 + (ended.tv_nsec - begun.tv_nsec) / 1e3;
    printf("%.2f microseconds a stop\n", took / COUNT);
}
