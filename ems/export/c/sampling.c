int NAME_start(NAME_state *state, const NAME_table *table, int engine_on)
{
    if (table == NULL || table->check != NAME_CHECK) {
        return NAME_WRONG_TABLE;
    }
    state->step = -1;
    state->last.control = engine_on ? 1 : 0;
    state->last.engine_torque_Nm = 0.0;
    state->last.battery_power_W = 0.0;
    state->last.fuel_kgps = 0.0;
    state->last.engine_on = engine_on;
    state->last.engine_next = engine_on;
    return NAME_OK;
}

int NAME_update(NAME_state *state, const NAME_table *table, double time_s, double step_s, double soc,
                double variance, NAME_output *out)
{
    /* Masters add up steps: what is less than a millionth of a step before its begin is at its begin. */
    const double steps = (time_s - step_s) / NAME_STEP_S + NAME_TOLERANCE;
    long step;
    int refused;
    if (!(step_s > 0.0 && step_s <= NAME_STEP_S * (1.0 + NAME_TOLERANCE))) {
        return NAME_LONG_STEP;
    }
    if (!(steps >= 0.0 && steps < NAME_STEPS)) {
        return NAME_BEYOND_TRIP;
    }
    step = (long)steps;
    if ((time_s / NAME_STEP_S - (double)step) > 1.0 + 2.0 * NAME_TOLERANCE) {
        return NAME_LONG_STEP;
    }
    if (step != state->step) {
        refused = NAME_decide(table, step, soc, variance, state->last.engine_next, &state->last);
        if (refused != NAME_OK) {
            return refused;
        }
        state->step = step;
    }
    *out = state->last;
    return NAME_OK;
}

void NAME_read(const NAME_state *state, NAME_output *out)
{
    *out = state->last;
}
