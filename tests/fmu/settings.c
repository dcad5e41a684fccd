/* Reads resources/battery.txt: one `key number...` per line, numbers in C's hexadecimal notation. */

#include "battery.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static double *numbers(char *text, int *count)
{
    double *all = NULL;
    int n = 0, room = 0;
    for (char *at = text, *end;; at = end) {
        double value = strtod(at, &end);
        if (end == at)
            break;
        if (n == room) {
            double *more = realloc(all, sizeof *all * (size_t)(room = room ? 2 * room : 8));
            if (!more) {
                free(all);
                *count = 0;
                return NULL;
            }
            all = more;
        }
        all[n++] = value;
    }
    *count = n;
    return all;
}

typedef struct {
    const char *key;
    size_t at;
} Place;

static const Place single[] = {
    {"sign", offsetof(Battery, set.sign)},
    {"fixed_step_s", offsetof(Battery, set.fixed_step_s)},
    {"drive_factor", offsetof(Battery, set.drive_unit.factor)},
    {"voltage_factor", offsetof(Battery, set.voltage.factor)},
    {"current_factor", offsetof(Battery, set.current.factor)},
    {"soc_factor", offsetof(Battery, set.soc.factor)},
    {"temperature_factor", offsetof(Battery, set.temperature.factor)},
    {"temperature_offset", offsetof(Battery, set.temperature.offset)},
    {"capacity_C", offsetof(Battery, set.capacity_C)},
    {"activation_K", offsetof(Battery, set.activation_K)},
    {"reference_K", offsetof(Battery, set.reference_K)},
    {"hysteresis_rate", offsetof(Battery, set.hysteresis_rate)},
    {"heat_capacity", offsetof(Battery, set.heat_capacity)},
    {"thermal_resistance", offsetof(Battery, set.thermal_resistance)},
    {"ambient_C", offsetof(Battery, starts.ambient_C)},
    {"initial_soc", offsetof(Battery, starts.soc)},
    {"capacity_factor", offsetof(Battery, starts.capacity_factor)},
    {"resistance_factor", offsetof(Battery, starts.resistance_factor)},
    {"event_time", offsetof(Battery, starts.event_time)},
    {"kick_V", offsetof(Battery, starts.kick_V)},
    {"event_soc", offsetof(Battery, starts.event_soc)},
    {"fault_time", offsetof(Battery, starts.fault_time)},
    {"fault_below_soc", offsetof(Battery, starts.fault_below_soc)},
    {"fault_size", offsetof(Battery, starts.fault_size)},
};

static const Place whole[] = {
    {"drive", offsetof(Battery, set.drive)},
    {"zeros_first", offsetof(Battery, set.zeros_first)},
    {"loads_max", offsetof(Battery, set.loads_max)},
    {"fault", offsetof(Battery, starts.fault)},
};

static int take(Battery *b, char *line)
{
    char *rest = line + strcspn(line, " \n");
    if (*rest)
        *rest++ = '\0';
    if (!strcmp(line, "token")) {
        snprintf(b->set.token, sizeof b->set.token, "%.*s", (int)strcspn(rest, "\n"), rest);
        return 1;
    }
    for (size_t i = 0; i < sizeof single / sizeof *single; i++)
        if (!strcmp(line, single[i].key)) {
            *(double *)((char *)b + single[i].at) = strtod(rest, NULL);
            return 1;
        }
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++)
        if (!strcmp(line, whole[i].key)) {
            *(int *)((char *)b + whole[i].at) = (int)strtol(rest, NULL, 10);
            return 1;
        }
    int *count = NULL, length;
    double **array = NULL;
    if (!strcmp(line, "knot")) {
        array = &b->set.knot;
        count = &b->set.knots;
    } else if (!strcmp(line, "cubic")) {
        array = &b->set.cubic;
        count = &length;
    } else if (!strcmp(line, "table")) {
        array = &b->set.table;
        count = &b->set.table_rows;
    } else if (!strcmp(line, "node_C")) {
        array = &b->set.node_C;
        count = &b->set.nodes;
    }
    if (!array)
        return 0;
    *array = numbers(rest, count);
    return *array != NULL;
}

static int read_all(Battery *b, FILE *file)
{
    enum { LINE = 1 << 20 };
    char *line = malloc(LINE);
    int good = line != NULL;
    while (good && fgets(line, LINE, file))
        good = take(b, line);
    free(line);
    if (!good || !b->set.knot || !b->set.cubic || !b->set.table || !b->set.node_C)
        return 0;
    b->set.table_rows /= COLUMNS * b->set.nodes;
    return 1;
}

Battery *battery_new(const char *name, const char *token, const char *folder)
{
    char path[4200];
    Battery *b = calloc(1, sizeof *b);
    if (!b)
        return NULL;
    snprintf(path, sizeof path, "%s/battery.txt", folder ? folder : "");
    FILE *file = fopen(path, "r");
    int good = file && read_all(b, file);
    if (file)
        fclose(file);
    if (!good || !token || strcmp(token, b->set.token)) {
        battery_free(b);
        return NULL;
    }
    snprintf(b->name, sizeof b->name, "%s", name ? name : "");
    battery_reset(b);
    return b;
}

void battery_free(Battery *b)
{
    free(b->set.knot);
    free(b->set.cubic);
    free(b->set.table);
    free(b->set.node_C);
    free(b);
}
