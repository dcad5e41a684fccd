int NAME_decide(const NAME_table *table, long step, double soc, double variance, int engine_on, NAME_output *out)
{
    double excess, start_W, wanted_W, least = 0.0;
    long chosen, c;
    int engine_next = 0;
    (void)variance;
    if (!(soc >= 0.0 && soc <= 1.0)) {
        return NAME_BAD_INPUT;
    }
    if (step < 0 || step >= NAME_STEPS) {
        return NAME_BEYOND_TRIP;
    }
    excess = (soc - NAME_SUSTAIN_SOC) / NAME_BAND;
    excess = excess < -1.0 ? -1.0 : excess;
    excess = excess > 1.0 ? 1.0 : excess;
    if (excess >= 0.0) {
        start_W = NAME_START_POWER_W + excess * (NAME_DEPLETE_POWER_W - NAME_START_POWER_W);
        wanted_W = -excess * NAME_DEPLETE_POWER_W;
    } else {
        start_W = (1.0 + excess) * NAME_START_POWER_W;
        wanted_W = -excess * NAME_CHARGE_POWER_W;
    }
    if (step + 1 < NAME_STEPS) {
        const double threshold_W = engine_on ? NAME_KEEP_RUNNING * start_W : start_W;
        engine_next = table->needs_engine[step + 1] != 0 || table->wheel_power_W[step + 1] > threshold_W;
    }
    chosen = table->first_choice[step];
    if (engine_on) {
        /* Idle, unless the wheels ask for something. */
        chosen += 1;
        if (table->wheel_power_W[step] > 0.0) {
            for (c = chosen; c < table->first_choice[step + 1]; c++) {
                const double miss = fabs(table->power_W[c] - wanted_W) +
                                    NAME_AVOID_SHORTFALL_W_PER_KG * table->shortfall_kg[c];
                if (c == table->first_choice[step] + 1 || miss < least) {
                    least = miss;
                    chosen = c;
                }
            }
        }
    }
    NAME_report(table, chosen, engine_on, engine_next, out);
    return NAME_OK;
}
