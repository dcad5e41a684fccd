/* The circuit of bms/_ecm.py: current held over a step, every state moved exactly; as an ODE for model exchange. */

#include "battery.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const double ABSOLUTE_ZERO_C = -273.15;
static const double LATE = 1e-9; /* a time event counts as reached this much before it, s */

typedef struct {
    double r, r1, tau1, r2, tau2, hysteresis_V;
} Values;

static double within(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

static double ocv(const Settings *s, double soc)
{
    double inside = within(soc, 0.0, 1.0);
    int at = 0;
    while (at < s->knots - 2 && inside >= s->knot[at + 1])
        at++;
    const double *c = s->cubic + 4 * at;
    double x = inside - s->knot[at];
    return ((c[0] * x + c[1]) * x + c[2]) * x + c[3];
}

static Values values_at(const Battery *b, double soc, double temperature_C)
{
    const Settings *s = &b->set;
    double found[COLUMNS], x = within(soc, 0.0, 1.0) * (s->table_rows - 1), y = 0.0;
    int m = (int)x, t = 0;
    if (m > s->table_rows - 2)
        m = s->table_rows - 2;
    x -= m;
    if (s->nodes > 1) {
        while (t < s->nodes - 2 && temperature_C >= s->node_C[t + 1])
            t++;
        y = within((temperature_C - s->node_C[t]) / (s->node_C[t + 1] - s->node_C[t]), 0.0, 1.0);
    }
    for (int column = 0; column < COLUMNS; column++) {
        const double *low = s->table + (t * s->table_rows + m) * COLUMNS + column;
        found[column] = low[0] + x * (low[COLUMNS] - low[0]);
        if (y > 0.0) {
            const double *high = low + s->table_rows * COLUMNS;
            double above = high[0] + x * (high[COLUMNS] - high[0]);
            found[column] += y * (above - found[column]);
        }
    }
    double warm = 1.0;
    if (s->activation_K > 0.0)
        warm = exp(s->activation_K * (1.0 / (temperature_C - ABSOLUTE_ZERO_C) - 1.0 / s->reference_K));
    double ohm = b->m.in.resistance_factor * warm;
    return (Values){found[0] * ohm,  found[1] * ohm,  found[2] * warm,
                    found[3] * ohm, found[4] * warm, found[5]};
}

static double temperature_C(const Battery *b)
{
    return b->set.heat_capacity > 0.0 ? b->m.x[4] : b->m.in.ambient_C;
}

/* Voltage behind the series resistance. */
static double inner_V(const Battery *b, const Values *v)
{
    const double *x = b->m.x;
    return ocv(&b->set, x[0]) + x[3] * v->hysteresis_V + x[1] + x[2];
}

static double capacity_C(const Battery *b)
{
    return b->set.capacity_C * b->m.in.capacity_factor;
}

/* The current that the input means at the present states; NaN when no current gives the power. */
static double current_now(const Battery *b)
{
    Values v = values_at(b, b->m.x[0], temperature_C(b));
    double drive = b->m.in.drive, inside = inner_V(b, &v);
    if (b->set.drive == DRIVE_CURRENT)
        return drive;
    if (b->set.drive == DRIVE_VOLTAGE)
        return (drive - inside) / v.r;
    return 2.0 * drive / (inside + sqrt(inside * inside + 4.0 * v.r * drive));
}

/* Brings what follows from input and states up to date (model exchange and initialisation). */
void battery_present(Battery *b)
{
    b->m.current_A = current_now(b);
}

void battery_reset(Battery *b)
{
    memset(&b->m, 0, sizeof b->m);
    b->m.in = b->starts;
    b->m.phase = INSTANTIATED;
}

void battery_initialise(Battery *b)
{
    Model *m = &b->m;
    m->x[0] = m->in.soc;
    m->x[1] = m->x[2] = m->x[3] = 0.0;
    m->x[4] = m->in.ambient_C;
    m->above = m->x[0] >= m->in.event_soc;
    m->crossings = m->kicked = m->stepped = m->steps = 0;
    battery_present(b);
}

static void advance(Battery *b, double step)
{
    Model *m = &b->m;
    const Settings *s = &b->set;
    double *x = m->x, current = m->current_A, moved = step * current / capacity_C(b);
    Values v = values_at(b, x[0], temperature_C(b));
    double over = inner_V(b, &v) - ocv(s, x[0]) + v.r * current;
    double e1 = exp(-step / v.tau1), e2 = exp(-step / v.tau2);
    if (s->heat_capacity > 0.0) {
        double target = m->in.ambient_C + s->thermal_resistance * current * over;
        double keep = exp(-step / (s->heat_capacity * s->thermal_resistance));
        x[4] = target + keep * (x[4] - target);
    } else {
        x[4] = m->in.ambient_C;
    }
    x[1] = e1 * x[1] + v.r1 * (1.0 - e1) * current;
    x[2] = e2 * x[2] + v.r2 * (1.0 - e2) * current;
    if (s->hysteresis_rate > 0.0 && moved != 0.0) {
        double keep = exp(-s->hysteresis_rate * fabs(moved));
        x[3] = keep * x[3] + copysign(1.0 - keep, moved);
    }
    x[0] += moved;
}

/* Discrete changes that are due: a kick of v1 at event_time, a count when SOC crosses event_soc. */
int battery_events(Battery *b, int *states_changed, double *next)
{
    Model *m = &b->m;
    *states_changed = 0;
    *next = -1.0;
    if (m->in.event_time >= 0.0 && !m->kicked) {
        if (m->time >= m->in.event_time - LATE) {
            m->x[1] += m->in.kick_V;
            m->kicked = *states_changed = 1;
        } else {
            *next = m->in.event_time;
        }
    }
    if ((m->x[0] >= m->in.event_soc) != m->above) {
        m->above = !m->above;
        m->crossings++;
    }
    battery_present(b);
    return OK;
}

/* One communication step; the current is found at its start and flows at its end as well. */
int battery_move(Battery *b, double t, double step)
{
    Model *m = &b->m;
    int changed;
    double next, first = step;
    m->time = t;
    m->current_A = current_now(b);
    if (!isfinite(m->current_A)) {
        battery_log(b, ERROR, "no current gives the power of %g W", m->in.drive);
        return ERROR;
    }
    if (m->in.event_time > t && m->in.event_time < t + step)
        first = m->in.event_time - t;
    double held = m->current_A;
    advance(b, first);
    if (first < step) {
        m->time = t + first;
        battery_events(b, &changed, &next);
        m->current_A = held;
        advance(b, step - first);
    }
    m->time = t + step;
    battery_events(b, &changed, &next);
    if (b->set.drive != DRIVE_VOLTAGE)
        m->current_A = held; /* a voltage is held at the terminals, and the current has changed meanwhile */
    m->stepped = 1;
    m->steps++;
    return OK;
}

void battery_derivatives(Battery *b, double *dx)
{
    const Settings *s = &b->set;
    const double *x = b->m.x;
    battery_present(b);
    double current = b->m.current_A, rate = current / capacity_C(b);
    Values v = values_at(b, x[0], temperature_C(b));
    dx[0] = rate;
    dx[1] = (v.r1 * current - x[1]) / v.tau1;
    dx[2] = (v.r2 * current - x[2]) / v.tau2;
    dx[3] = s->hysteresis_rate * (rate - fabs(rate) * x[3]);
    dx[4] = 0.0;
    if (s->heat_capacity > 0.0) {
        double over = inner_V(b, &v) - ocv(s, x[0]) + v.r * current;
        dx[4] = (current * over - (x[4] - b->m.in.ambient_C) / s->thermal_resistance) / s->heat_capacity;
    }
}

static double output(const Unit *unit, double value)
{
    return (value - unit->offset) / unit->factor;
}

int battery_get(Battery *b, unsigned vr, double *value)
{
    Model *m = &b->m;
    double dx[STATES];
    const Settings *s = &b->set;
    if (m->phase < STEPPING)
        battery_initialise(b);
    else if (b->exchange)
        battery_present(b);
    int blank = s->zeros_first && !m->stepped;
    Values v = values_at(b, m->x[0], temperature_C(b));
    switch (vr) {
    case VR_TIME: *value = m->time; break;
    case VR_DRIVE: *value = output(&s->drive_unit, m->in.drive * (s->drive == DRIVE_VOLTAGE ? 1.0 : s->sign)); break;
    case VR_AMBIENT: *value = output(&s->temperature, m->in.ambient_C); break;
    case VR_VOLTAGE:
        *value = blank ? 0.0 : output(&s->voltage, inner_V(b, &v) + v.r * m->current_A + m->residue_V);
        break;
    case VR_CURRENT: *value = blank ? 0.0 : output(&s->current, s->sign * m->current_A); break;
    case VR_SOC: *value = blank ? 0.0 : output(&s->soc, m->x[0]); break;
    case VR_TEMPERATURE: *value = blank ? 0.0 : output(&s->temperature, temperature_C(b)); break;
    case VR_INITIAL_SOC: *value = output(&s->soc, m->in.soc); break;
    case VR_CAPACITY_FACTOR: *value = m->in.capacity_factor; break;
    case VR_RESISTANCE_FACTOR: *value = m->in.resistance_factor; break;
    case VR_EVENT_TIME: *value = m->in.event_time; break;
    case VR_KICK: *value = m->in.kick_V; break;
    case VR_EVENT_SOC: *value = m->in.event_soc; break;
    case VR_FAULT_TIME: *value = m->in.fault_time; break;
    case VR_FAULT_BELOW_SOC: *value = m->in.fault_below_soc; break;
    case VR_FAULT_SIZE: *value = m->in.fault_size; break;
    case VR_INDICATOR: *value = m->x[0] - m->in.event_soc; break;
    default:
        if (vr >= VR_STATE && vr < VR_STATE + STATES) {
            *value = m->x[vr - VR_STATE];
        } else if (vr >= VR_DERIVATIVE && vr < VR_DERIVATIVE + STATES) {
            battery_derivatives(b, dx);
            *value = dx[vr - VR_DERIVATIVE];
        } else {
            battery_log(b, ERROR, "there is no floating-point variable %u", vr);
            return ERROR;
        }
    }
    *value = fault_output(b, vr, *value);
    return OK;
}

int battery_set(Battery *b, unsigned vr, double value)
{
    Inputs *in = &b->m.in;
    const Settings *s = &b->set;
    if (vr >= VR_INITIAL_SOC && vr < VR_STATE && b->m.phase >= STEPPING) {
        battery_log(b, ERROR, "parameter %u cannot be set after initialisation", vr);
        return ERROR;
    }
    switch (vr) {
    case VR_DRIVE:
        in->drive = (s->drive_unit.factor * value + s->drive_unit.offset) * (s->drive == DRIVE_VOLTAGE ? 1.0 : s->sign);
        break;
    case VR_AMBIENT: in->ambient_C = s->temperature.factor * value + s->temperature.offset; break;
    case VR_INITIAL_SOC: in->soc = s->soc.factor * value; break;
    case VR_CAPACITY_FACTOR: in->capacity_factor = value; break;
    case VR_RESISTANCE_FACTOR: in->resistance_factor = value; break;
    case VR_EVENT_TIME: in->event_time = value; break;
    case VR_KICK: in->kick_V = value; break;
    case VR_EVENT_SOC: in->event_soc = value; break;
    case VR_FAULT_TIME: in->fault_time = value; break;
    case VR_FAULT_BELOW_SOC: in->fault_below_soc = value; break;
    case VR_FAULT_SIZE: in->fault_size = value; break;
    default:
        battery_log(b, ERROR, "there is no floating-point variable %u that can be set", vr);
        return ERROR;
    }
    return OK;
}

int battery_get_integer(Battery *b, unsigned vr, int *value)
{
    if (vr != VR_CROSSINGS && vr != VR_FAULT) {
        battery_log(b, ERROR, "there is no integer variable %u", vr);
        return ERROR;
    }
    *value = vr == VR_FAULT ? b->m.in.fault : b->m.crossings;
    return OK;
}

int battery_set_integer(Battery *b, unsigned vr, int value)
{
    if (vr != VR_FAULT || b->m.phase >= STEPPING) {
        battery_log(b, ERROR, "integer variable %u cannot be set now", vr);
        return ERROR;
    }
    b->m.in.fault = value;
    return OK;
}

void battery_log(Battery *b, int status, const char *text, ...)
{
    char message[256];
    va_list rest;
    va_start(rest, text);
    vsnprintf(message, sizeof message, text, rest);
    va_end(rest);
    if (b->log && (b->logging || status != OK))
        b->log(b, status, status >= ERROR ? "logStatusError" : "logStatusWarning", message);
}
