static void NAME_report(const NAME_table *table, long chosen, int engine_on, int engine_next, NAME_output *out)
{
    out->control = table->control[chosen];
    out->engine_torque_Nm = table->torque_Nm[chosen];
    out->battery_power_W = table->power_W[chosen];
    out->fuel_kgps = table->fuel_kgps[chosen];
    out->engine_on = engine_on;
    out->engine_next = engine_next;
}
