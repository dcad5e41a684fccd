/* What goes wrong with FMUs, on purpose, chosen by the parameter `fault`, from the time `fault_time` on, in
   realizations that start below the SOC `fault_below_soc`; `fault_size` is in bytes or seconds. */

#define _GNU_SOURCE
#include "battery.h"

#include <fenv.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifndef _WIN32
#include <time.h>
#include <unistd.h>
#endif

static volatile double nought = 0.0;
static volatile double sink;
static volatile int forever = 1;
static double kept_V; /* outlives every instance: FAULT_INSTANCE_KEEPS */

#ifndef _WIN32
/* Counts how often this library was loaded into the process. */
__attribute__((constructor)) static void count_loads(void)
{
    char text[16];
    const char *before = getenv("BATTERY_FMU_LOADS");
    snprintf(text, sizeof text, "%d", (before ? atoi(before) : 0) + 1);
    setenv("BATTERY_FMU_LOADS", text, 1);
}
#endif

static int loads(void)
{
    const char *count = getenv("BATTERY_FMU_LOADS");
    return count ? atoi(count) : 0;
}

static void crash(void)
{
    *(volatile int *)(size_t)nought = 1;
}

static void trap(void)
{
#ifdef __GLIBC__
    feenableexcept(FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW);
    sink = 1.0 / nought;
#endif
    raise(SIGFPE);
}

/* Not a tail call, and too much on the stack to be optimised away. */
static int deeper(int level)
{
    volatile char page[4096];
    page[level % 4096] = (char)level;
    return forever ? deeper(level + 1) + page[(level + 1) % 4096] : level;
}

static void pause_s(double seconds)
{
#ifdef _WIN32
    (void)seconds;
#else
    struct timespec left = {(time_t)seconds, (long)((seconds - floor(seconds)) * 1e9)};
    nanosleep(&left, NULL);
#endif
}

static void endless(void)
{
    while (forever)
        sink += 1.0;
}

static void flood_log(Battery *b)
{
    char line[1025];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = '\0';
    for (double written = 0.0; written < b->m.in.fault_size; written += 1024.0)
        b->log(b, WARNING, "logStatusWarning", line);
}

static void flood_streams(double bytes)
{
    char line[1025];
    memset(line, 'y', sizeof line - 2);
    line[sizeof line - 2] = '\n';
    line[sizeof line - 1] = '\0';
    for (double written = 0.0; written < bytes; written += 2048.0) {
        fputs(line, stdout);
        fputs(line, stderr);
    }
    fflush(stdout);
}

/* Takes memory until there is none, as a leak does, then goes on as if there had been some. */
static void exhaust(double bytes)
{
    enum { CHUNK = 16 << 20 };
    for (double taken = 0.0; taken < bytes; taken += CHUNK) {
        char *chunk = malloc(CHUNK);
        memset(chunk, 1, CHUNK);
        sink = chunk[CHUNK / 2];
    }
}

static void close_files(void)
{
#ifndef _WIN32
    for (int file = 0; file < 256; file++)
        close(file);
#endif
}

int fault_due(const Battery *b, double t)
{
    const Inputs *in = &b->m.in;
    return in->fault != FAULT_NONE && t >= in->fault_time - 1e-9 && in->soc < in->fault_below_soc;
}

int fault_while_running(Battery *b, double t)
{
    if (!fault_due(b, t))
        return OK;
    switch (b->m.in.fault) {
    case FAULT_WARNING:
        battery_log(b, WARNING, "the cell is warm at %g s", t);
        return WARNING;
    case FAULT_DISCARD:
        battery_log(b, DISCARD, "the step at %g s is too long", t);
        return DISCARD;
    case FAULT_ERROR:
        battery_log(b, ERROR, "the cell is on fire at %g s", t);
        return ERROR;
    case FAULT_FATAL:
        battery_log(b, FATAL, "the cell has left at %g s", t);
        b->m.phase = DEAD; /* see call_allowed */
        return FATAL;
    case FAULT_SEGFAULT: crash(); break;
    case FAULT_ABORT: abort();
    case FAULT_EXIT: exit(3);
    case FAULT_FLOATING_POINT: trap(); break;
    case FAULT_STACK: sink = deeper(0); break;
    case FAULT_ENDLESS: endless(); break;
    case FAULT_KILL: raise(SIGKILL); break;
    case FAULT_SLOW: pause_s(b->m.in.fault_size); break;
    case FAULT_LOG_FLOOD: flood_log(b); break;
    case FAULT_STREAM_FLOOD: flood_streams(b->m.in.fault_size); break;
    case FAULT_MEMORY: exhaust(b->m.in.fault_size); break;
    case FAULT_CLOSE_FILES: close_files(); break;
    case FAULT_INSTANCE_KEEPS: kept_V += 1e-3; break;
    case FAULT_TRAP_LEFT_ON:
#ifdef __GLIBC__
        feenableexcept(FE_DIVBYZERO | FE_INVALID);
#endif
        break;
    default: break;
    }
    return OK;
}

double fault_output(const Battery *b, unsigned vr, double value)
{
    if (vr != VR_VOLTAGE)
        return value;
    if (b->m.in.fault == FAULT_INSTANCE_KEEPS)
        return value + kept_V;
    if (!b->m.stepped || !fault_due(b, b->m.time))
        return value;
    if (b->m.in.fault == FAULT_NAN)
        return NAN;
    return b->m.in.fault == FAULT_INFINITE ? INFINITY : value;
}

/* These come before parameters can be set: the start value in battery.txt counts. */
int fault_at_instantiate(Battery *b)
{
    if (b->set.loads_max > 0 && loads() > b->set.loads_max) {
        fprintf(stderr, "loaded %d times\n", loads());
        abort();
    }
    switch (b->m.in.fault) {
    case FAULT_AT_INSTANTIATE: crash(); break;
    case FAULT_ENDLESS_INSTANTIATE: endless(); break;
    case FAULT_NO_INSTANCE: battery_log(b, ERROR, "no licence for the battery"); return 0;
    default: break;
    }
    return 1;
}

static int keeps(int fault)
{
    return fault == FAULT_RESET_KEEPS || fault == FAULT_STATE_KEEPS || fault == FAULT_INSTANCE_KEEPS;
}

void fault_after_reset(Battery *b, const Model *before)
{
    if (keeps(before->in.fault) && before->stepped)
        b->m.residue_V = before->residue_V + 0.01;
}

void fault_after_state(Battery *b, const Model *before)
{
    int fault = before->in.fault;
    if ((fault == FAULT_STATE_KEEPS || fault == FAULT_INSTANCE_KEEPS) && before->stepped)
        b->m.residue_V = before->residue_V + 0.01;
}

int fault_at_reset(Battery *b)
{
    if (b->m.in.fault == FAULT_AT_RESET && fault_due(b, b->m.time))
        crash();
    return OK;
}

int fault_at_terminate(Battery *b)
{
    if (b->m.in.fault == FAULT_AT_TERMINATE && fault_due(b, b->m.time))
        crash();
    return OK;
}

void fault_at_free(Battery *b)
{
    if (b->m.in.fault == FAULT_AT_FREE && fault_due(b, b->m.time))
        crash();
    if (b->m.in.fault == FAULT_ENDLESS_FREE && fault_due(b, b->m.time))
        endless();
}

int fault_at_initialise(Battery *b)
{
    if (b->m.in.fault != FAULT_INITIALISE_ERROR || !fault_due(b, b->m.time))
        return OK;
    battery_log(b, ERROR, "no start for a battery with %g of its charge", b->m.in.soc);
    return ERROR;
}
