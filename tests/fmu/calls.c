/* What FMI 2.0 and 3.0 have in common: which call is allowed when, steps, reset, and the state. */

#include "battery.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* After a fatal error the standard allows no call at all, not even to free the instance. */
int call_allowed(const Battery *b, const char *function, unsigned phases)
{
    static const char *const names[] = {"instantiated",      "initialising", "stepping",
                                        "handling an event", "terminated",   "dead"};
    if (!b)
        return 0;
    if (b->m.phase == DEAD) {
        fprintf(stderr, "%s was called after a fatal error\n", function);
        abort();
    }
    if (phases >> b->m.phase & 1U)
        return 1;
    battery_log((Battery *)b, ERROR, "%s is not allowed while %s", function, names[b->m.phase]);
    return 0;
}

int call_step(Battery *b, double t, double step)
{
    Model *m = &b->m;
    const double fixed = b->set.fixed_step_s;
    if (!(step > 0.0) || (fixed > 0.0 && fabs(step - fixed) > 1e-9)) {
        battery_log(b, ERROR, "a step of %g s was asked for; this battery knows steps of %g s only", step, fixed);
        return ERROR;
    }
    if (fabs(t - m->time) > 1e-6) {
        battery_log(b, ERROR, "a step from %g s was asked for; the battery is at %g s", t, m->time);
        return ERROR;
    }
    int status = fault_while_running(b, t);
    if (status >= DISCARD)
        return status;
    int moved = battery_move(b, t, step);
    return moved > status ? moved : status;
}

int call_derivatives(Battery *b, double *dx, size_t n)
{
    if (n != STATES)
        return ERROR;
    int status = fault_while_running(b, b->m.time);
    if (status >= DISCARD)
        return status;
    battery_derivatives(b, dx);
    return status;
}

int call_initialise(Battery *b)
{
    const double soc = b->m.in.soc;
    if (!(soc >= 0.0 && soc <= 1.0)) {
        battery_log(b, ERROR, "the initial SOC is %g; allowed is 0 to 1", soc);
        return ERROR;
    }
    if (fault_at_initialise(b) != OK)
        return ERROR;
    battery_initialise(b);
    b->m.phase = b->exchange ? EVENTS : STEPPING;
    return OK;
}

int call_reset(Battery *b)
{
    Model before = b->m;
    fault_at_reset(b);
    battery_reset(b);
    fault_after_reset(b, &before);
    return OK;
}

int call_terminate(Battery *b)
{
    fault_at_terminate(b);
    b->m.phase = TERMINATED;
    return OK;
}

int call_get(Battery *b, const unsigned vr[], size_t n, double value[])
{
    int status = OK;
    for (size_t i = 0; i < n && status == OK; i++)
        status = battery_get(b, vr[i], value + i);
    return status;
}

int call_set(Battery *b, const unsigned vr[], size_t n, const double value[])
{
    int status = OK;
    for (size_t i = 0; i < n && status == OK; i++)
        status = battery_set(b, vr[i], value[i]);
    return status;
}

int call_get_integer(Battery *b, const unsigned vr[], size_t n, int value[])
{
    int status = OK;
    for (size_t i = 0; i < n && status == OK; i++)
        status = battery_get_integer(b, vr[i], value + i);
    return status;
}

int call_set_integer(Battery *b, const unsigned vr[], size_t n, const int value[])
{
    int status = OK;
    for (size_t i = 0; i < n && status == OK; i++)
        status = battery_set_integer(b, vr[i], value[i]);
    return status;
}

int call_set_time(Battery *b, double t)
{
    b->m.time = t;
    b->m.stepped = b->m.stepped || t > 0.0;
    return OK;
}

int call_keep(Battery *b, void **state)
{
    if (!*state)
        *state = malloc(sizeof b->m);
    if (!*state)
        return ERROR;
    memcpy(*state, &b->m, sizeof b->m);
    return OK;
}

int call_restore(Battery *b, const void *state)
{
    Model before = b->m;
    memcpy(&b->m, state, sizeof b->m);
    fault_after_state(b, &before);
    return OK;
}
