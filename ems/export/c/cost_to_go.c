/* Cost-to-go of the next stage with the engine off and on: linear or cubic in SOC, quadratic in the variance. */
typedef struct {
    double off;
    double on;
} NAME_pair;

static double NAME_clip(double x, double low, double high)
{
    const double raised = x < low ? low : x;
    return raised > high ? high : raised;
}

/* First of the three levels, uniform in their square root, around a variance, and the parabola's weights. */
#if NAME_ROWS > 1
static long NAME_levels(const double level[], long count, double level_step, double variance, double weight[3])
{
    long q = (long)(sqrt(variance) / level_step - 0.5);
    double p0, p1, p2, x0, x1, x2;
    q = q < count - 3 ? q : count - 3;
    q = q > 0 ? q : 0;
    p0 = level[q];
    p1 = level[q + 1];
    p2 = level[q + 2];
    x0 = variance - p0;
    x1 = variance - p1;
    x2 = variance - p2;
    weight[0] = x1 * x2 / ((p0 - p1) * (p0 - p2));
    weight[1] = x0 * x2 / ((p1 - p0) * (p1 - p2));
    weight[2] = x0 * x1 / ((p2 - p0) * (p2 - p1));
    return q;
}
#endif

/* First of the four nodes around a grid coordinate, and their weights. */
static long NAME_nodes(double x, double weight[4])
{
    const double inside = NAME_clip(x, 0.0, NAME_NODES - 1.0);
    long at = (long)inside - 1;
    double t;
    at = at > 0 ? at : 0;
    at = at < NAME_NODES - 4 ? at : NAME_NODES - 4;
    t = inside - (double)at;
#if NAME_CUBIC
    {
        const double a = t, b = t - 1.0, c = t - 2.0, d = t - 3.0;
        weight[0] = -b * c * d / 6.0;
        weight[1] = 0.5 * a * c * d;
        weight[2] = -0.5 * a * b * d;
        weight[3] = a * b * c / 6.0;
    }
#else
    {
        const long first = (long)t < 2 ? (long)t : 2;
        t -= (double)first;
        weight[0] = 0.0;
        weight[1] = 0.0;
        weight[2] = 0.0;
        weight[3] = 0.0;
        weight[first] = 1.0 - t;
        weight[first + 1] = t;
    }
#endif
    return at;
}

static NAME_pair NAME_expected(const NAME_table *table, long step, double soc, double spread, double variance)
{
    static const double node[3] = {NAME_MINUS_ROOT_3, 0.0, NAME_ROOT_3};
    static const double share[3] = {1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0};
    const int single = spread <= 0.0;
    NAME_pair sum = {0.0, 0.0};
    double level_weight[3] = {1.0, 0.0, 0.0};
    long q = 0, row;
    int m;
#if NAME_ROWS > 1
    q = NAME_levels(table->variance, NAME_ROWS, NAME_LEVEL_STEP, variance, level_weight);
#else
    (void)variance;
#endif
    for (m = 0; m < 3; m++) {
        double w[4];
        long at;
        if (single && m != 1) {
            continue;
        }
        at = NAME_nodes((soc + spread * node[m] - NAME_SOC_FIRST) / NAME_SOC_STEP, w);
        for (row = 0; row < (NAME_ROWS < 3 ? NAME_ROWS : 3); row++) {
            const double factor = (single ? 1.0 : share[m]) * level_weight[row];
            const float *off = &table->cost_to_go_kg[step][0][q + row][at];
            const float *on = &table->cost_to_go_kg[step][1][q + row][at];
            sum.off += factor * (w[0] * off[0] + w[1] * off[1] + w[2] * off[2] + w[3] * off[3]);
            sum.on += factor * (w[0] * on[0] + w[1] * on[1] + w[2] * on[2] + w[3] * on[3]);
        }
    }
    return sum;
}

/* Current in A that gives a power at the terminals, within limits; and the discharge power that these withhold. */
static double NAME_current(const NAME_table *table, double soc, double power_W, double *missing_W)
{
    const double x = NAME_clip((soc - NAME_SOC_FIRST) / NAME_SOC_STEP, 0.0, NAME_NODES - 1.0);
    const long at = (long)x < NAME_NODES - 2 ? (long)x : NAME_NODES - 2;
    const double t = x - (double)at;
#define NAME_AT(member) (table->member[at] + t * (table->member[at + 1] - table->member[at]))
    const double ocv_V = NAME_AT(ocv_V);
    const double discharge_ohm = NAME_AT(discharge_ohm);
    const double ohm = power_W < 0.0 ? discharge_ohm : NAME_AT(charge_ohm);
    const double low_A = NAME_AT(least_current_A), high_A = NAME_AT(greatest_current_A);
#undef NAME_AT
    const double square = ocv_V * ocv_V + 4.0 * ohm * power_W;
    const double current_A = 2.0 * power_W / (ocv_V + sqrt(square > 0.0 ? square : 0.0));
    *missing_W = 0.0;
    if (current_A < low_A) {
        *missing_W = low_A * (ocv_V + discharge_ohm * low_A) - power_W;
        return low_A;
    }
    return current_A < high_A ? current_A : high_A;
}

#if NAME_ACTS_ON == NAME_ESTIMATE
/* What the next measurement leaves of the variance, and by what deviation it moves the estimate. */
static void NAME_weigh(const NAME_table *table, double soc, double variance, double *posterior, double *spread)
{
    const double largest = table->filter_variance[NAME_FILTER_LEVELS - 1];
    const double inside = variance < largest ? variance : largest;
    const double x = NAME_clip(soc, 0.0, 1.0) * (NAME_FILTER_NODES - 1);
    const long at = (long)x < NAME_FILTER_NODES - 2 ? (long)x : NAME_FILTER_NODES - 2;
    double weight[3], found[3], measured, total, gain;
    int i;
    const long q =
        NAME_levels(table->filter_variance, NAME_FILTER_LEVELS, NAME_FILTER_LEVEL_STEP, inside, weight);
    for (i = 0; i < 3; i++) {
        const double *row = table->filter_measured[q + i];
        found[i] = row[at] + (x - (double)at) * (row[at + 1] - row[at]);
    }
    measured = weight[0] * found[0];
    measured += weight[1] * found[1] + weight[2] * found[2];
    measured = measured > 0.0 ? measured : 0.0;
    total = variance + measured;
    gain = total > 0.0 ? variance / total : 0.0;
    *posterior = gain * measured;
    *spread = sqrt(gain * variance);
}
#endif

int NAME_decide(const NAME_table *table, long step, double soc, double variance, int engine_on, NAME_output *out)
{
    double posterior = 0.0, spread = 0.0, best = 0.0;
    long chosen = -1, c, first, last;
    int engine_next = engine_on;
    if (!(soc >= 0.0 && soc <= 1.0) || !(variance >= 0.0) || isinf(variance)) {
        return NAME_BAD_INPUT;
    }
    if (step < 0 || step >= NAME_STEPS) {
        return NAME_BEYOND_TRIP;
    }
#if NAME_ACTS_ON == NAME_ESTIMATE
    NAME_weigh(table, soc, variance, &posterior, &spread);
#endif
    first = table->first_choice[step] + (engine_on ? 1 : 0);
    last = engine_on ? table->first_choice[step + 1] : first + 1;
    for (c = first; c < last; c++) {
        double missing_W, drift, cost_kg, width = spread;
        const double current_A = NAME_current(table, soc, table->power_W[c], &missing_W);
        NAME_pair after;
        drift = NAME_DRIFT + NAME_DRIFT_PER_A * fabs(current_A);
#if NAME_ACTS_ON == NAME_TRUTH
        width = sqrt(drift);
#endif
        after = NAME_expected(table, step, soc + NAME_CHARGE_TO_SOC * current_A, width, posterior + drift);
        if (!engine_on) {
            after.on += NAME_START_KG;
        }
        cost_kg = table->cost_kg[c] + missing_W * NAME_STEP_S * NAME_SHORTFALL_KG_PER_J +
                  (after.off < after.on ? after.off : after.on);
        if (chosen < 0 || cost_kg < best) {
            best = cost_kg;
            chosen = c;
            engine_next = after.on < after.off;
        }
    }
    NAME_report(table, chosen, engine_on, engine_next, out);
    return NAME_OK;
}
