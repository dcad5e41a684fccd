/* The battery behind FMI 2.0, for co-simulation and model exchange. */

#include "battery.h"

#include "fmi2Functions.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define UNUSED(x) (void)(x)
#define AT(phase) (1U << (phase))
#define RUNNING (AT(STEPPING) | AT(EVENTS))
#define ALIVE (AT(INSTANTIATED) | AT(INITIALISING) | RUNNING | AT(TERMINATED))
#define REQUIRE(phases)                     \
    Battery *b = c;                         \
    if (!call_allowed(b, __func__, phases)) \
    return fmi2Error

static void tell(Battery *b, int status, const char *category, const char *message)
{
    const fmi2CallbackFunctions *callback = b->callback;
    if (callback->logger)
        callback->logger(b->environment, b->name, (fmi2Status)status, category, message);
}

/* The folder of a file URI, its percent escapes undone. */
static void folder_of(const char *uri, char *path, size_t size)
{
    size_t n = 0;
    uri = uri ? uri : "";
    if (!strncmp(uri, "file://", 7))
        uri += 7;
    while (*uri && n + 1 < size) {
        unsigned code;
        if (*uri == '%' && sscanf(uri + 1, "%2x", &code) == 1) {
            path[n++] = (char)code;
            uri += 3;
        } else {
            path[n++] = *uri++;
        }
    }
    path[n] = '\0';
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callback, fmi2Boolean visible, fmi2Boolean logging)
{
    char path[4100];
    UNUSED(visible);
    folder_of(resources, path, sizeof path);
    Battery *b = battery_new(name, guid, path);
    if (!b) {
        if (callback->logger)
            callback->logger(callback->componentEnvironment, name, fmi2Error, "logStatusError",
                             "cannot read %s/battery.txt, or it belongs to another battery", path);
        return NULL;
    }
    b->exchange = type == fmi2ModelExchange;
    b->logging = logging;
    b->log = tell;
    b->environment = callback->componentEnvironment;
    b->callback = (void *)callback;
    if (fault_at_instantiate(b))
        return b;
    battery_free(b);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    Battery *b = c;
    if (!call_allowed(b, __func__, ALIVE))
        return;
    fault_at_free(b);
    battery_free(b);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    REQUIRE(ALIVE);
    UNUSED(n);
    UNUSED(categories);
    b->logging = on;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop)
{
    REQUIRE(AT(INSTANTIATED));
    UNUSED(given);
    UNUSED(tolerance);
    UNUSED(stops);
    UNUSED(stop);
    b->m.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REQUIRE(AT(INSTANTIATED));
    b->m.phase = INITIALISING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REQUIRE(AT(INITIALISING));
    return (fmi2Status)call_initialise(b);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    REQUIRE(RUNNING);
    return (fmi2Status)call_terminate(b);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(ALIVE);
    return (fmi2Status)call_reset(b);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    REQUIRE(AT(INITIALISING) | RUNNING | AT(TERMINATED));
    return (fmi2Status)call_get(b, vr, n, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    REQUIRE(AT(INSTANTIATED) | AT(INITIALISING) | RUNNING);
    return (fmi2Status)call_set(b, vr, n, value);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    REQUIRE(AT(INITIALISING) | RUNNING | AT(TERMINATED));
    return (fmi2Status)call_get_integer(b, vr, n, value);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    REQUIRE(AT(INSTANTIATED) | AT(INITIALISING));
    return (fmi2Status)call_set_integer(b, vr, n, value);
}

/* There are no variables of these types. */
typedef fmi2ValueReference Reference;
#define NONE_OF(Type)                                                                                       \
    fmi2Status fmi2Get##Type(fmi2Component c, const Reference vr[], size_t n, fmi2##Type value[])           \
    {                                                                                                       \
        UNUSED(c), UNUSED(vr), UNUSED(value);                                                               \
        return n ? fmi2Error : fmi2OK;                                                                      \
    }                                                                                                       \
    fmi2Status fmi2Set##Type(fmi2Component c, const Reference vr[], size_t n, const fmi2##Type value[])     \
    {                                                                                                       \
        UNUSED(c), UNUSED(vr), UNUSED(value);                                                               \
        return n ? fmi2Error : fmi2OK;                                                                      \
    }
NONE_OF(Boolean)
NONE_OF(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(ALIVE);
    return (fmi2Status)call_keep(b, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REQUIRE(ALIVE);
    return (fmi2Status)call_restore(b, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    UNUSED(c);
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    UNUSED(c);
    UNUSED(state);
    *size = sizeof(Model);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    UNUSED(c);
    if (size < sizeof(Model))
        return fmi2Error;
    memcpy(bytes, state, sizeof(Model));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    UNUSED(c);
    if (size < sizeof(Model) || (!*state && !(*state = malloc(sizeof(Model)))))
        return fmi2Error;
    memcpy(*state, bytes, sizeof(Model));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real along[],
                                        fmi2Real value[])
{
    UNUSED(c), UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns), UNUSED(along), UNUSED(value);
    return fmi2Error;
}

/* Model exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    REQUIRE(RUNNING);
    b->m.phase = EVENTS;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    double next;
    int changed;
    REQUIRE(AT(EVENTS));
    battery_events(b, &changed, &next);
    *info = (fmi2EventInfo){fmi2False, fmi2False, fmi2False, changed, next >= 0.0, next};
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    REQUIRE(AT(EVENTS));
    b->m.phase = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *stop)
{
    REQUIRE(AT(STEPPING));
    UNUSED(final);
    *event = *stop = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t)
{
    REQUIRE(RUNNING);
    return (fmi2Status)call_set_time(b, t);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    REQUIRE(AT(STEPPING));
    if (n != STATES)
        return fmi2Error;
    memcpy(b->m.x, x, sizeof b->m.x);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    return (fmi2Status)call_derivatives(b, dx, n);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    if (n != 1)
        return fmi2Error;
    z[0] = b->m.x[0] - b->m.in.event_soc;
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    REQUIRE(AT(INITIALISING) | RUNNING);
    if (n != STATES)
        return fmi2Error;
    memcpy(x, b->m.x, sizeof b->m.x);
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    REQUIRE(ALIVE);
    for (size_t i = 0; i < n; i++)
        nominal[i] = 1.0;
    return n == STATES ? fmi2OK : fmi2Error;
}

/* Co-simulation */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    UNUSED(c), UNUSED(vr), UNUSED(order), UNUSED(value);
    return n ? fmi2Error : fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    UNUSED(c), UNUSED(vr), UNUSED(order), UNUSED(value);
    return n ? fmi2Error : fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real step, fmi2Boolean no_set_state)
{
    REQUIRE(AT(STEPPING));
    UNUSED(no_set_state);
    return (fmi2Status)call_step(b, t, step);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    UNUSED(c);
    return fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    UNUSED(c), UNUSED(kind), UNUSED(value);
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    REQUIRE(RUNNING);
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = b->m.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    UNUSED(c), UNUSED(kind), UNUSED(value);
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    REQUIRE(RUNNING);
    if (kind != fmi2Terminated)
        return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    UNUSED(c), UNUSED(kind), UNUSED(value);
    return fmi2Discard;
}
