/* The battery behind FMI 3.0, for co-simulation and model exchange; what it does not have stands in fmi3_rest.c. */

#include "battery.h"

#include "fmi3Functions.h"

#include <stdlib.h>
#include <string.h>

#define UNUSED(x) (void)(x)
#define AT(phase) (1U << (phase))
#define RUNNING (AT(STEPPING) | AT(EVENTS))
#define ALIVE (AT(INSTANTIATED) | AT(INITIALISING) | RUNNING | AT(TERMINATED))
#define REQUIRE(phases)                     \
    Battery *b = c;                         \
    if (!call_allowed(b, __func__, phases)) \
    return fmi3Error

static void tell(Battery *b, int status, const char *category, const char *message)
{
    fmi3LogMessageCallback callback;
    memcpy(&callback, &b->callback, sizeof callback);
    if (callback)
        callback(b->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

static fmi3Instance instantiate(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean logging,
                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback, int exchange)
{
    Battery *b = battery_new(name, token, resources);
    if (!b) {
        if (callback)
            callback(environment, fmi3Error, "logStatusError",
                     "cannot read resources/battery.txt, or it belongs to another battery");
        return NULL;
    }
    b->exchange = exchange;
    b->logging = logging;
    b->log = tell;
    b->environment = environment;
    memcpy(&b->callback, &callback, sizeof callback);
    if (fault_at_instantiate(b))
        return b;
    battery_free(b);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback)
{
    UNUSED(visible);
    return instantiate(name, token, resources, logging, environment, callback, 1);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
                                         fmi3Boolean early_return, const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback,
                                         fmi3IntermediateUpdateCallback update)
{
    UNUSED(visible), UNUSED(early_return), UNUSED(required), UNUSED(n), UNUSED(update);
    if (event_mode)
        return NULL;
    return instantiate(name, token, resources, logging, environment, callback, 0);
}

void fmi3FreeInstance(fmi3Instance c)
{
    Battery *b = c;
    if (!call_allowed(b, __func__, ALIVE))
        return;
    fault_at_free(b);
    battery_free(b);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    REQUIRE(ALIVE);
    UNUSED(n), UNUSED(categories);
    b->logging = on;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean given, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stops, fmi3Float64 stop)
{
    REQUIRE(AT(INSTANTIATED));
    UNUSED(given), UNUSED(tolerance), UNUSED(stops), UNUSED(stop);
    b->m.time = start;
    b->m.phase = INITIALISING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    REQUIRE(AT(INITIALISING));
    return (fmi3Status)call_initialise(b);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    REQUIRE(RUNNING);
    return (fmi3Status)call_terminate(b);
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    REQUIRE(ALIVE);
    return (fmi3Status)call_reset(b);
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t values)
{
    REQUIRE(AT(INITIALISING) | RUNNING | AT(TERMINATED));
    return n == values ? (fmi3Status)call_get(b, vr, n, value) : fmi3Error;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t values)
{
    REQUIRE(AT(INSTANTIATED) | AT(INITIALISING) | RUNNING);
    return n == values ? (fmi3Status)call_set(b, vr, n, value) : fmi3Error;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 value[], size_t values)
{
    REQUIRE(AT(INITIALISING) | RUNNING | AT(TERMINATED));
    return n == values ? (fmi3Status)call_get_integer(b, vr, n, value) : fmi3Error;
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 value[],
                        size_t values)
{
    REQUIRE(AT(INSTANTIATED) | AT(INITIALISING));
    return n == values ? (fmi3Status)call_set_integer(b, vr, n, value) : fmi3Error;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    REQUIRE(ALIVE);
    return (fmi3Status)call_keep(b, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    REQUIRE(ALIVE);
    return (fmi3Status)call_restore(b, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    UNUSED(c);
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    UNUSED(c), UNUSED(state);
    *size = sizeof(Model);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    UNUSED(c);
    if (size < sizeof(Model))
        return fmi3Error;
    memcpy(bytes, state, sizeof(Model));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    UNUSED(c);
    if (size < sizeof(Model) || (!*state && !(*state = malloc(sizeof(Model)))))
        return fmi3Error;
    memcpy(*state, bytes, sizeof(Model));
    return fmi3OK;
}

/* Model exchange */

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    REQUIRE(RUNNING);
    b->m.phase = EVENTS;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *stop, fmi3Boolean *nominals,
                                    fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *at)
{
    double next;
    int changed;
    REQUIRE(AT(EVENTS));
    battery_events(b, &changed, &next);
    *again = *stop = *nominals = fmi3False;
    *states = changed != 0;
    *defined = next >= 0.0;
    *at = next;
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    REQUIRE(AT(EVENTS));
    b->m.phase = STEPPING;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *stop)
{
    REQUIRE(AT(STEPPING));
    UNUSED(final);
    *event = *stop = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t)
{
    REQUIRE(RUNNING);
    return (fmi3Status)call_set_time(b, t);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    REQUIRE(AT(STEPPING));
    if (n != STATES)
        return fmi3Error;
    memcpy(b->m.x, x, sizeof b->m.x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    return (fmi3Status)call_derivatives(b, dx, n);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    if (n != 1)
        return fmi3Error;
    z[0] = b->m.x[0] - b->m.in.event_soc;
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    if (n != STATES)
        return fmi3Error;
    memcpy(x, b->m.x, sizeof b->m.x);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominal[], size_t n)
{
    REQUIRE(ALIVE);
    for (size_t i = 0; i < n; i++)
        nominal[i] = 1.0;
    return n == STATES ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    REQUIRE(ALIVE);
    *n = 1;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    REQUIRE(ALIVE);
    *n = STATES;
    return fmi3OK;
}

/* Co-simulation */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 step, fmi3Boolean no_set_state, fmi3Boolean *event,
                      fmi3Boolean *stop, fmi3Boolean *early, fmi3Float64 *reached)
{
    REQUIRE(AT(STEPPING));
    UNUSED(no_set_state);
    fmi3Status status = (fmi3Status)call_step(b, t, step);
    *event = *stop = *early = fmi3False;
    *reached = b->m.time;
    return status;
}
