/* A battery as a functional mock-up unit, for tests: the circuit of bms/_ecm.py and a choice of faults.

   battery.c  the circuit, its states and its variables, in SI units and with the sign of this project
   settings.c reads resources/battery.txt: the cell, start values, units and habits of this variant
   faults.c   what goes wrong, and when
   calls.c    what the two interfaces have in common: phases, steps, reset, state
   fmi2.c, fmi3.c  the two interfaces; either is compiled together with the rest */

#ifndef BATTERY_H
#define BATTERY_H

#include <stddef.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL }; /* the same in FMI 2.0 and 3.0 */

/* Value references; fmu_files.py reads them from here. */
enum {
    VR_TIME = 0,
    VR_DRIVE = 1,
    VR_AMBIENT = 2,
    VR_VOLTAGE = 10,
    VR_CURRENT = 11,
    VR_SOC = 12,
    VR_TEMPERATURE = 13,
    VR_CROSSINGS = 14,
    VR_INITIAL_SOC = 20,
    VR_CAPACITY_FACTOR = 21,
    VR_RESISTANCE_FACTOR = 22,
    VR_EVENT_TIME = 23,
    VR_KICK = 24,
    VR_EVENT_SOC = 25,
    VR_FAULT = 30,
    VR_FAULT_TIME = 31,
    VR_FAULT_BELOW_SOC = 32,
    VR_FAULT_SIZE = 33,
    VR_STATE = 40,      /* SOC, v1, v2, h, temperature */
    VR_DERIVATIVE = 50, /* of these */
    VR_INDICATOR = 60,
};

/* fmu_files.py reads the names of the faults from here. */
enum {
    FAULT_NONE = 0,
    FAULT_NAN = 1,
    FAULT_INFINITE = 2,
    FAULT_WARNING = 3,
    FAULT_DISCARD = 4,
    FAULT_ERROR = 5,
    FAULT_FATAL = 6,
    FAULT_SEGFAULT = 10,
    FAULT_ABORT = 11,
    FAULT_EXIT = 12,
    FAULT_FLOATING_POINT = 13,
    FAULT_STACK = 14,
    FAULT_ENDLESS = 15,
    FAULT_KILL = 16,
    FAULT_SLOW = 17,
    FAULT_LOG_FLOOD = 20,
    FAULT_STREAM_FLOOD = 21,
    FAULT_MEMORY = 22,
    FAULT_CLOSE_FILES = 23,
    FAULT_RESET_KEEPS = 30,
    FAULT_STATE_KEEPS = 31,
    FAULT_INSTANCE_KEEPS = 32,
    FAULT_AT_INSTANTIATE = 40,
    FAULT_NO_INSTANCE = 41,
    FAULT_INITIALISE_ERROR = 42,
    FAULT_AT_RESET = 43,
    FAULT_AT_TERMINATE = 44,
    FAULT_AT_FREE = 45,
    FAULT_ENDLESS_INSTANTIATE = 46,
    FAULT_ENDLESS_FREE = 47,
    FAULT_TRAP_LEFT_ON = 48,
};

enum { STATES = 5, COLUMNS = 6 };
enum { DRIVE_CURRENT, DRIVE_POWER, DRIVE_VOLTAGE };
enum { INSTANTIATED, INITIALISING, STEPPING, EVENTS, TERMINATED, DEAD };

typedef struct {
    double factor, offset; /* SI (and degrees Celsius) = factor * the variable + offset */
} Unit;

typedef struct {
    char token[64];
    int drive, zeros_first;
    double sign; /* -1: current and power are positive when discharging */
    double fixed_step_s; /* 0: any */
    int loads_max; /* abort when the library was loaded more often; 0: never */
    Unit drive_unit, voltage, current, soc, temperature;
    double capacity_C, activation_K, reference_K, hysteresis_rate, heat_capacity, thermal_resistance;
    double *knot, *cubic, *table, *node_C;
    int knots, table_rows, nodes;
} Settings;

/* What the outside sets: start values come from resources/battery.txt, in SI. */
typedef struct {
    double drive, ambient_C, soc, capacity_factor, resistance_factor;
    double event_time, kick_V, event_soc;
    double fault_time, fault_below_soc, fault_size;
    int fault;
} Inputs;

/* All that moves; copied whole for reset and for the FMU state. */
typedef struct {
    Inputs in;
    double x[STATES]; /* SOC, v1, v2, h, temperature in deg C */
    double current_A, time;
    double residue_V; /* what a faulty reset leaves behind */
    int phase, stepped, kicked, above, crossings, steps;
} Model;

typedef struct Battery {
    Settings set;
    Inputs starts;
    Model m;
    int exchange, logging;
    void (*log)(struct Battery *b, int status, const char *category, const char *message);
    void *environment, *callback;
    char name[64];
} Battery;

/* battery.c */
void battery_reset(Battery *b);
void battery_initialise(Battery *b);
void battery_present(Battery *b);
int battery_move(Battery *b, double t, double step);
void battery_derivatives(Battery *b, double *dx);
int battery_events(Battery *b, int *states_changed, double *next);
int battery_get(Battery *b, unsigned vr, double *value);
int battery_set(Battery *b, unsigned vr, double value);
int battery_get_integer(Battery *b, unsigned vr, int *value);
int battery_set_integer(Battery *b, unsigned vr, int value);
void battery_log(Battery *b, int status, const char *text, ...);

/* settings.c */
Battery *battery_new(const char *name, const char *token, const char *folder);
void battery_free(Battery *b);

/* calls.c */
int call_allowed(const Battery *b, const char *function, unsigned phases);
int call_step(Battery *b, double t, double step);
int call_derivatives(Battery *b, double *dx, size_t n);
int call_initialise(Battery *b);
int call_reset(Battery *b);
int call_terminate(Battery *b);
int call_get(Battery *b, const unsigned vr[], size_t n, double value[]);
int call_set(Battery *b, const unsigned vr[], size_t n, const double value[]);
int call_get_integer(Battery *b, const unsigned vr[], size_t n, int value[]);
int call_set_integer(Battery *b, const unsigned vr[], size_t n, const int value[]);
int call_set_time(Battery *b, double t);
int call_keep(Battery *b, void **state);
int call_restore(Battery *b, const void *state);

/* faults.c */
int fault_due(const Battery *b, double t);
int fault_while_running(Battery *b, double t);
double fault_output(const Battery *b, unsigned vr, double value);
int fault_at_instantiate(Battery *b);
void fault_after_reset(Battery *b, const Model *before);
void fault_after_state(Battery *b, const Model *before);
int fault_at_reset(Battery *b);
int fault_at_terminate(Battery *b);
void fault_at_free(Battery *b);
int fault_at_initialise(Battery *b);

#endif
