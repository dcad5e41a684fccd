/* @DESCRIPTION
 *
 * A policy for a known trip: at every step it says what the engine does, from the state of charge (SOC), its
 * variance where the policy acts on it, and whether the engine runs. No heap, no files, no global state.
 * Constant tables are handed in: link NAME_data.c and pass &NAME_data, or pass the content of NAME.bin at an
 * address that is a multiple of 8.
 *
 * Units: SI; SOC is a fraction; battery power > 0 charges. Compile with -ffp-contract=off for the same bits on
 * every machine.
 */
#ifndef NAME_H
#define NAME_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

@CONSTANTS

/* What the functions give: NAME_OK, or why nothing was done. */
enum { @CODES };

@TABLE

typedef struct {
    long control;            /* 0: engine off, 1: idling, others: clutch closed */
    double engine_torque_Nm; /* at the crank */
    double battery_power_W;  /* asked of the terminals, > 0 charges */
    double fuel_kgps;
    int engine_on;           /* in this step */
    int engine_next;         /* in the next */
} NAME_output;

/* What is remembered between calls; free of pointers: may be copied and stored. */
typedef struct {
    long step;
    NAME_output last;
} NAME_state;

/* The tables, if NAME_data.c is linked. */
extern const NAME_table NAME_data;

/* The decision at a step, 0 to NAME_STEPS - 1; depends on nothing else, changes nothing but *out. */
int NAME_decide(const NAME_table *table, long step, double soc, double variance, int engine_on, NAME_output *out);

/* Bring the state to the begin of the trip. */
int NAME_start(NAME_state *state, const NAME_table *table, int engine_on);

/* Advance by step_s to time_s, the time since the begin of the trip. A decision is taken in the first call of
 * each step of NAME_STEP_S and held in the others. */
int NAME_update(NAME_state *state, const NAME_table *table, double time_s, double step_s, double soc,
                double variance, NAME_output *out);

/* What was decided last. */
void NAME_read(const NAME_state *state, NAME_output *out);

#ifdef __cplusplus
}
#endif

#endif
