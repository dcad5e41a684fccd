/* What the wrappers for FMI 2.0 and FMI 3.0 share: instances, phases, values, snapshots.
 *
 * model.h and model.c are generated for one block; model.h defines
 *   MODEL_TOKEN       the GUID or instantiation token
 *   MODEL_VARIABLES   number of variables; their value references are 0 .. MODEL_VARIABLES - 1,
 *                     the last is the time
 *   model_state       the block with its inputs and outputs, of a fixed size
 *   MODEL_DATA_FILE   file among the resources with the block's constant data, where it has some,
 *   MODEL_DATA_BYTES  and its size
 */
#ifndef FMU_H
#define FMU_H

#include <stddef.h>

#include "model.h"

#define FMU_TIME_VARIABLE (MODEL_VARIABLES - 1u)

/* As fmi2Status and fmi3Status number them. */
enum fmu_status { FMU_OK = 0, FMU_ERROR = 3 };

/* Phases of an instance, as bits, so that a function can name those in which it may be called. */
enum fmu_phase {
    FMU_INSTANTIATED = 1,
    FMU_INITIALIZING = 2,
    FMU_STEPPING = 4,
    FMU_TERMINATED = 8,
    FMU_FAILED = 16,
    FMU_ANY_PHASE = 31
};

enum fmu_kind { FMU_REAL, FMU_INTEGER, FMU_BOOLEAN };
enum fmu_causality { FMU_PARAMETER, FMU_INPUT, FMU_OUTPUT, FMU_INDEPENDENT };

typedef struct {
    const char *name;
    enum fmu_kind kind;
    enum fmu_causality causality;
    double start;
} fmu_variable;

typedef struct {
    char text[256];
} fmu_message;

/* In model.c. What starts and steps the block gives 0, or else the reason is in the message. */
extern const fmu_variable model_variable[MODEL_VARIABLES];
int model_start(model_state *w, const void *data, double value[], fmu_message *message);
int model_step(model_state *w, const void *data, double value[], double time_s, double step_s,
               fmu_message *message);

/* Everything that an FMU state must bring back. */
typedef struct {
    char token[sizeof MODEL_TOKEN];
    int phase;
    int stop_defined;
    double stop_s;
    double value[MODEL_VARIABLES];
    model_state state;
} fmu_snapshot;

typedef struct fmu_instance fmu_instance;
typedef void (*fmu_log)(const fmu_instance *fmu, int status, const char *message);

struct fmu_instance {
    fmu_snapshot now;
    void *data; /* constant, hence in no snapshot */
    char *name;
    fmu_log log;
    void *environment;
    void (*callback)(void); /* of the type that the version's logger has */
};

fmu_instance *fmu_new(const char *name, const char *token, const char *resources, fmu_log log,
                      void (*callback)(void), void *environment);
void fmu_free(fmu_instance *fmu);

/* Say what is wrong, in two parts, and end up in FMU_FAILED. */
int fmu_fail(fmu_instance *fmu, const char *function, const char *message);
int fmu_allowed(fmu_instance *fmu, int phases, const char *function);

int fmu_setup(fmu_instance *fmu, double start_s, int stop_defined, double stop_s, const char *function);
int fmu_enter_initialization(fmu_instance *fmu, const char *function);
int fmu_exit_initialization(fmu_instance *fmu, const char *function);
int fmu_terminate(fmu_instance *fmu, const char *function);
int fmu_reset(fmu_instance *fmu);

int fmu_read(fmu_instance *fmu, unsigned reference, enum fmu_kind kind, double *value, const char *function);
int fmu_write(fmu_instance *fmu, unsigned reference, enum fmu_kind kind, double value, const char *function);
int fmu_step(fmu_instance *fmu, double time_s, double step_s, const char *function);

int fmu_get_state(fmu_instance *fmu, void **state, const char *function);
int fmu_set_state(fmu_instance *fmu, const void *state, const char *function);
int fmu_free_state(fmu_instance *fmu, void **state, const char *function);
int fmu_state_size(fmu_instance *fmu, const void *state, size_t *size, const char *function);
int fmu_serialize(fmu_instance *fmu, const void *state, void *bytes, size_t size, const char *function);
int fmu_deserialize(fmu_instance *fmu, const void *bytes, size_t size, void **state, const char *function);

#endif
