/* FMI 2.0 for co-simulation around one block, see fmu.h. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu.h"

#define READABLE (FMU_INITIALIZING | FMU_STEPPING | FMU_TERMINATED | FMU_FAILED)
#define WRITABLE (FMU_INSTANTIATED | FMU_INITIALIZING | FMU_STEPPING)

static void log_message(const fmu_instance *fmu, int status, const char *message)
{
    fmi2CallbackLogger logger = (fmi2CallbackLogger)fmu->callback;
    if (logger != NULL) {
        /* The message goes in as it is, not behind "%s": several masters show the format. None holds a '%'. */
        logger(fmu->environment, fmu->name == NULL ? "" : fmu->name, (fmi2Status)status, "logStatusError",
               message);
    }
}

static int unsupported(fmu_instance *fmu, const char *function)
{
    return fmu == NULL ? FMU_ERROR : fmu_fail(fmu, function, "this FMU does not support it");
}

/* A type of which there is no variable: asking for none is fine. */
static fmi2Status no_variables(fmi2Component c, int phases, size_t count, const char *function)
{
    fmu_instance *fmu = c;
    if (fmu_allowed(fmu, phases, function) != FMU_OK) {
        return fmi2Error;
    }
    return count == 0 ? fmi2OK : (fmi2Status)fmu_fail(fmu, function, "no variable is of this type");
}

static int hex(char digit)
{
    if (digit >= '0' && digit <= '9') {
        return digit - '0';
    }
    if (digit >= 'a' && digit <= 'f') {
        return digit - 'a' + 10;
    }
    return digit >= 'A' && digit <= 'F' ? digit - 'A' + 10 : -1;
}

/* "file:///a%20b" or "file:/a%20b" to "/a b/"; "file:///C:/a" to "C:/a/". To be freed; NULL if it is no file. */
static char *path_of(const char *uri)
{
    size_t length, i, used = 0;
    char *path;
    if (uri == NULL || strncmp(uri, "file:", 5) != 0) {
        return NULL;
    }
    uri += 5;
    if (strncmp(uri, "//localhost/", 12) == 0) {
        uri += 11;
    } else if (strncmp(uri, "///", 3) == 0) {
        uri += 2;
    }
    if (uri[0] == '/' && uri[1] != '\0' && uri[2] == ':') {
        uri += 1;
    }
    length = strlen(uri);
    path = malloc(length + 2);
    if (path == NULL) {
        return NULL;
    }
    for (i = 0; i < length; i++) {
        if (uri[i] == '%' && i + 2 < length && hex(uri[i + 1]) >= 0 && hex(uri[i + 2]) >= 0) {
            path[used++] = (char)(16 * hex(uri[i + 1]) + hex(uri[i + 2]));
            i += 2;
        } else {
            path[used++] = uri[i];
        }
    }
    if (used > 0 && path[used - 1] != '/') {
        path[used++] = '/';
    }
    path[used] = '\0';
    return path;
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    /* There are error messages and no others, and these are always given. */
    (void)loggingOn;
    (void)nCategories;
    (void)categories;
    return c == NULL ? fmi2Error : fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    char *resources;
    fmu_instance *fmu;
    (void)visible;
    (void)loggingOn;
    if (functions == NULL || functions->logger == NULL) {
        return NULL;
    }
    if (fmuType != fmi2CoSimulation) {
        functions->logger(functions->componentEnvironment, instanceName == NULL ? "" : instanceName, fmi2Error,
                          "logStatusError", "fmi2Instantiate: this FMU is for co-simulation only");
        return NULL;
    }
    resources = path_of(fmuResourceLocation);
    fmu = fmu_new(instanceName, fmuGUID, resources, log_message, (void (*)(void))functions->logger,
                  functions->componentEnvironment);
    free(resources);
    return fmu;
}

void fmi2FreeInstance(fmi2Component c)
{
    fmu_free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    if (fmu_allowed(c, FMU_INSTANTIATED, "fmi2SetupExperiment") != FMU_OK) {
        return fmi2Error;
    }
    return (fmi2Status)fmu_setup(c, startTime, stopTimeDefined, stopTime, "fmi2SetupExperiment");
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return (fmi2Status)fmu_enter_initialization(c, "fmi2EnterInitializationMode");
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return (fmi2Status)fmu_exit_initialization(c, "fmi2ExitInitializationMode");
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return (fmi2Status)fmu_terminate(c, "fmi2Terminate");
}

fmi2Status fmi2Reset(fmi2Component c)
{
    return (fmi2Status)fmu_reset(c);
}

static fmi2Status start_access(fmi2Component c, int phases, const void *vr, size_t nvr, const void *value,
                               const char *function)
{
    if (fmu_allowed(c, phases, function) != FMU_OK) {
        return fmi2Error;
    }
    if (nvr > 0 && (vr == NULL || value == NULL)) {
        return (fmi2Status)fmu_fail(c, function, "a null pointer for value references or values");
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    size_t i;
    if (start_access(c, READABLE, vr, nvr, value, "fmi2GetReal") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_read(c, vr[i], FMU_REAL, &value[i], "fmi2GetReal") != FMU_OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    size_t i;
    double number;
    if (start_access(c, READABLE, vr, nvr, value, "fmi2GetInteger") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_read(c, vr[i], FMU_INTEGER, &number, "fmi2GetInteger") != FMU_OK) {
            return fmi2Error;
        }
        value[i] = (fmi2Integer)number;
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    size_t i;
    double number;
    if (start_access(c, READABLE, vr, nvr, value, "fmi2GetBoolean") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_read(c, vr[i], FMU_BOOLEAN, &number, "fmi2GetBoolean") != FMU_OK) {
            return fmi2Error;
        }
        value[i] = number != 0.0 ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr;
    (void)value;
    return no_variables(c, READABLE, nvr, "fmi2GetString");
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    size_t i;
    if (start_access(c, WRITABLE, vr, nvr, value, "fmi2SetReal") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_write(c, vr[i], FMU_REAL, value[i], "fmi2SetReal") != FMU_OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    size_t i;
    if (start_access(c, WRITABLE, vr, nvr, value, "fmi2SetInteger") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_write(c, vr[i], FMU_INTEGER, (double)value[i], "fmi2SetInteger") != FMU_OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    size_t i;
    if (start_access(c, WRITABLE, vr, nvr, value, "fmi2SetBoolean") != fmi2OK) {
        return fmi2Error;
    }
    for (i = 0; i < nvr; i++) {
        if (fmu_write(c, vr[i], FMU_BOOLEAN, value[i] ? 1.0 : 0.0, "fmi2SetBoolean") != FMU_OK) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return no_variables(c, WRITABLE, nvr, "fmi2SetString");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    return (fmi2Status)fmu_get_state(c, FMUstate, "fmi2GetFMUstate");
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    return (fmi2Status)fmu_set_state(c, FMUstate, "fmi2SetFMUstate");
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    return (fmi2Status)fmu_free_state(c, FMUstate, "fmi2FreeFMUstate");
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    return (fmi2Status)fmu_state_size(c, FMUstate, size, "fmi2SerializedFMUstateSize");
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    return (fmi2Status)fmu_serialize(c, FMUstate, serializedState, size, "fmi2SerializeFMUstate");
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    return (fmi2Status)fmu_deserialize(c, serializedState, size, FMUstate, "fmi2DeSerializeFMUstate");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                        const fmi2Real dvKnown[], fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return (fmi2Status)unsupported(c, "fmi2GetDirectionalDerivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : (fmi2Status)unsupported(c, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return nvr == 0 && c != NULL ? fmi2OK : (fmi2Status)unsupported(c, "fmi2GetRealOutputDerivatives");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    return (fmi2Status)fmu_step(c, currentCommunicationPoint, communicationStepSize, "fmi2DoStep");
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    /* Steps are done when fmi2DoStep returns; there is never one to cancel. */
    return (fmi2Status)unsupported(c, "fmi2CancelStep");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    return c == NULL ? fmi2Error : fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    fmu_instance *fmu = c;
    if (fmu == NULL || value == NULL) {
        return fmi2Error;
    }
    if (s != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = fmu->now.value[FMU_TIME_VARIABLE];
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    return c == NULL ? fmi2Error : fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if (c == NULL || value == NULL) {
        return fmi2Error;
    }
    if (s != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    return c == NULL ? fmi2Error : fmi2Discard;
}
