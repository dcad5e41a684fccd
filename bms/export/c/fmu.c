/* What the wrappers for FMI 2.0 and FMI 3.0 share, see fmu.h. Memory is taken for instances and snapshots only. */
#include "fmu.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Points in time that differ by less than this share of a step are the same: masters add up steps. */
#define FMU_TIME_TOLERANCE 1e-6
#define FMU_RELATIVE_TOLERANCE 1e-9

static void fmu_start_values(fmu_snapshot *now)
{
    size_t i;
    memset(now, 0, sizeof *now);
    memcpy(now->token, MODEL_TOKEN, sizeof MODEL_TOKEN);
    now->phase = FMU_INSTANTIATED;
    for (i = 0; i < MODEL_VARIABLES; i++) {
        now->value[i] = model_variable[i].start;
    }
}

/* Read the block's data; what is wrong goes to the log. */
static int fmu_open(fmu_instance *fmu, const char *resources)
{
#ifdef MODEL_DATA_FILE
    static const char file[] = MODEL_DATA_FILE;
    size_t length = resources == NULL ? 0 : strlen(resources);
    char *path = malloc(length + sizeof file);
    FILE *stream = NULL;
    int whole = 0;
    fmu->data = malloc(MODEL_DATA_BYTES);
    if (path == NULL || fmu->data == NULL) {
        free(path);
        fmu->log(fmu, FMU_ERROR, "instantiate: no memory is left");
        return FMU_ERROR;
    }
    if (length > 0) {
        memcpy(path, resources, length);
        memcpy(path + length, file, sizeof file);
        stream = fopen(path, "rb");
    }
    free(path);
    if (stream != NULL) {
        whole = fread(fmu->data, 1, MODEL_DATA_BYTES, stream) == MODEL_DATA_BYTES && fgetc(stream) == EOF;
        (void)fclose(stream);
    }
    if (!whole) {
        fmu->log(fmu, FMU_ERROR, "instantiate: " MODEL_DATA_FILE " is not in the folder of resources, or not whole");
        return FMU_ERROR;
    }
#else
    (void)fmu;
    (void)resources;
#endif
    return FMU_OK;
}

fmu_instance *fmu_new(const char *name, const char *token, const char *resources, fmu_log log,
                      void (*callback)(void), void *environment)
{
    fmu_instance *fmu = calloc(1, sizeof *fmu);
    size_t length;
    if (fmu == NULL) {
        return NULL;
    }
    fmu->log = log;
    fmu->callback = callback;
    fmu->environment = environment;
    fmu_start_values(&fmu->now);
    if (name == NULL || name[0] == '\0') {
        log(fmu, FMU_ERROR, "instantiate: the instance has no name");
        free(fmu);
        return NULL;
    }
    length = strlen(name) + 1;
    fmu->name = malloc(length);
    if (fmu->name == NULL) {
        free(fmu);
        return NULL;
    }
    memcpy(fmu->name, name, length);
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        log(fmu, FMU_ERROR, "instantiate: the GUID or token is not that of this FMU, " MODEL_TOKEN);
    } else if (fmu_open(fmu, resources) == FMU_OK) {
        return fmu;
    }
    fmu_free(fmu);
    return NULL;
}

void fmu_free(fmu_instance *fmu)
{
    if (fmu != NULL) {
        free(fmu->data);
        free(fmu->name);
        free(fmu);
    }
}

int fmu_fail(fmu_instance *fmu, const char *function, const char *message)
{
    char text[sizeof(fmu_message) + 64];
    (void)snprintf(text, sizeof text, "%s: %s", function, message);
    fmu->log(fmu, FMU_ERROR, text);
    fmu->now.phase = FMU_FAILED;
    return FMU_ERROR;
}

static const char *fmu_phase_name(int phase)
{
    switch (phase) {
    case FMU_INSTANTIATED:
        return "instantiated";
    case FMU_INITIALIZING:
        return "in initialization mode";
    case FMU_STEPPING:
        return "between steps";
    case FMU_TERMINATED:
        return "terminated";
    default:
        return "after an error";
    }
}

int fmu_allowed(fmu_instance *fmu, int phases, const char *function)
{
    char text[64];
    if (fmu == NULL) {
        return FMU_ERROR;
    }
    if ((fmu->now.phase & phases) == 0) {
        (void)snprintf(text, sizeof text, "not allowed %s", fmu_phase_name(fmu->now.phase));
        return fmu_fail(fmu, function, text);
    }
    return FMU_OK;
}

int fmu_setup(fmu_instance *fmu, double start_s, int stop_defined, double stop_s, const char *function)
{
    if (!isfinite(start_s) || (stop_defined && !(stop_s >= start_s))) {
        return fmu_fail(fmu, function, "the start must be a number and the stop not before it");
    }
    fmu->now.value[FMU_TIME_VARIABLE] = start_s;
    fmu->now.stop_defined = stop_defined;
    fmu->now.stop_s = stop_s;
    return FMU_OK;
}

static int fmu_start(fmu_instance *fmu, const char *function)
{
    fmu_message message = {""};
    if (model_start(&fmu->now.state, fmu->data, fmu->now.value, &message) != 0) {
        return fmu_fail(fmu, function, message.text);
    }
    return FMU_OK;
}

int fmu_enter_initialization(fmu_instance *fmu, const char *function)
{
    if (fmu_allowed(fmu, FMU_INSTANTIATED, function) != FMU_OK) {
        return FMU_ERROR;
    }
    fmu->now.phase = FMU_INITIALIZING;
    return FMU_OK;
}

int fmu_exit_initialization(fmu_instance *fmu, const char *function)
{
    if (fmu_allowed(fmu, FMU_INITIALIZING, function) != FMU_OK || fmu_start(fmu, function) != FMU_OK) {
        return FMU_ERROR;
    }
    fmu->now.phase = FMU_STEPPING;
    return FMU_OK;
}

int fmu_terminate(fmu_instance *fmu, const char *function)
{
    if (fmu_allowed(fmu, FMU_STEPPING, function) != FMU_OK) {
        return FMU_ERROR;
    }
    fmu->now.phase = FMU_TERMINATED;
    return FMU_OK;
}

int fmu_reset(fmu_instance *fmu)
{
    if (fmu == NULL) {
        return FMU_ERROR;
    }
    fmu_start_values(&fmu->now);
    return FMU_OK;
}

static const fmu_variable *fmu_find(fmu_instance *fmu, unsigned reference, enum fmu_kind kind, const char *function)
{
    char text[96];
    if (reference >= MODEL_VARIABLES) {
        (void)snprintf(text, sizeof text, "no variable has the value reference %u", reference);
    } else if (model_variable[reference].kind != kind) {
        (void)snprintf(text, sizeof text, "the variable with the value reference %u is of another type", reference);
    } else {
        return &model_variable[reference];
    }
    (void)fmu_fail(fmu, function, text);
    return NULL;
}

int fmu_read(fmu_instance *fmu, unsigned reference, enum fmu_kind kind, double *value, const char *function)
{
    const fmu_variable *variable = fmu_find(fmu, reference, kind, function);
    if (variable == NULL) {
        return FMU_ERROR;
    }
    if (fmu->now.phase == FMU_INITIALIZING && variable->causality == FMU_OUTPUT &&
        fmu_start(fmu, function) != FMU_OK) {
        return FMU_ERROR;
    }
    *value = fmu->now.value[reference];
    return FMU_OK;
}

int fmu_write(fmu_instance *fmu, unsigned reference, enum fmu_kind kind, double value, const char *function)
{
    const fmu_variable *variable = fmu_find(fmu, reference, kind, function);
    char text[160];
    if (variable == NULL) {
        return FMU_ERROR;
    }
    if (variable->causality == FMU_INPUT ||
        (variable->causality == FMU_PARAMETER && fmu->now.phase != FMU_STEPPING)) {
        fmu->now.value[reference] = value;
        return FMU_OK;
    }
    (void)snprintf(text, sizeof text, "%.80s cannot be set %s", variable->name,
                   variable->causality == FMU_PARAMETER ? "after initialization" : "at all");
    return fmu_fail(fmu, function, text);
}

int fmu_step(fmu_instance *fmu, double time_s, double step_s, const char *function)
{
    fmu_message message = {""};
    double tolerance_s;
    if (fmu_allowed(fmu, FMU_STEPPING, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (!isfinite(time_s) || !isfinite(step_s) || step_s <= 0.0) {
        return fmu_fail(fmu, function, "the step must be positive, and time and step must be numbers");
    }
    tolerance_s = fmax(FMU_TIME_TOLERANCE * step_s, FMU_RELATIVE_TOLERANCE * fabs(time_s));
    if (fabs(time_s - fmu->now.value[FMU_TIME_VARIABLE]) > tolerance_s) {
        return fmu_fail(fmu, function, "the step does not begin where the last one ended");
    }
    if (fmu->now.stop_defined && time_s + step_s > fmu->now.stop_s + tolerance_s) {
        return fmu_fail(fmu, function, "the step goes beyond the stop time");
    }
    if (model_step(&fmu->now.state, fmu->data, fmu->now.value, time_s, step_s, &message) != 0) {
        return fmu_fail(fmu, function, message.text);
    }
    fmu->now.value[FMU_TIME_VARIABLE] = time_s + step_s;
    return FMU_OK;
}

static int fmu_is_snapshot(const void *state)
{
    const fmu_snapshot *snapshot = state;
    return snapshot != NULL && memcmp(snapshot->token, MODEL_TOKEN, sizeof MODEL_TOKEN) == 0;
}

int fmu_get_state(fmu_instance *fmu, void **state, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (state == NULL || (*state != NULL && !fmu_is_snapshot(*state))) {
        return fmu_fail(fmu, function, "no place for the state, or one that is no state of this FMU");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(fmu_snapshot));
        if (*state == NULL) {
            return fmu_fail(fmu, function, "no memory is left");
        }
    }
    memcpy(*state, &fmu->now, sizeof(fmu_snapshot));
    return FMU_OK;
}

int fmu_set_state(fmu_instance *fmu, const void *state, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (!fmu_is_snapshot(state)) {
        return fmu_fail(fmu, function, "this is no state of this FMU");
    }
    memcpy(&fmu->now, state, sizeof(fmu_snapshot));
    return FMU_OK;
}

int fmu_free_state(fmu_instance *fmu, void **state, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (state != NULL && *state != NULL) {
        if (!fmu_is_snapshot(*state)) {
            return fmu_fail(fmu, function, "this is no state of this FMU");
        }
        memset(*state, 0, sizeof MODEL_TOKEN);
        free(*state);
        *state = NULL;
    }
    return FMU_OK;
}

int fmu_state_size(fmu_instance *fmu, const void *state, size_t *size, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (size == NULL || !fmu_is_snapshot(state)) {
        return fmu_fail(fmu, function, "this is no state of this FMU, or there is no place for its size");
    }
    *size = sizeof(fmu_snapshot);
    return FMU_OK;
}

int fmu_serialize(fmu_instance *fmu, const void *state, void *bytes, size_t size, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (bytes == NULL || size < sizeof(fmu_snapshot) || !fmu_is_snapshot(state)) {
        return fmu_fail(fmu, function, "this is no state of this FMU, or its place is too small");
    }
    memcpy(bytes, state, sizeof(fmu_snapshot));
    return FMU_OK;
}

int fmu_deserialize(fmu_instance *fmu, const void *bytes, size_t size, void **state, const char *function)
{
    if (fmu_allowed(fmu, FMU_ANY_PHASE, function) != FMU_OK) {
        return FMU_ERROR;
    }
    if (bytes == NULL || size != sizeof(fmu_snapshot) || !fmu_is_snapshot(bytes)) {
        return fmu_fail(fmu, function, "these bytes are no state of this FMU");
    }
    if (state == NULL || (*state != NULL && !fmu_is_snapshot(*state))) {
        return fmu_fail(fmu, function, "no place for the state, or one that is no state of this FMU");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(fmu_snapshot));
        if (*state == NULL) {
            return fmu_fail(fmu, function, "no memory is left");
        }
    }
    memcpy(*state, bytes, sizeof(fmu_snapshot));
    return FMU_OK;
}
