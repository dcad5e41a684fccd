/* Functions of FMI 3.0 that have to be there and that the battery has no use for. */

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)
typedef fmi3ValueReference Reference;

#define NONE_OF(Type)                                                                                            \
    fmi3Status fmi3Get##Type(fmi3Instance c, const Reference vr[], size_t n, fmi3##Type value[], size_t values)  \
    {                                                                                                            \
        UNUSED(c), UNUSED(vr), UNUSED(value), UNUSED(values);                                                    \
        return n ? fmi3Error : fmi3OK;                                                                           \
    }                                                                                                            \
    fmi3Status fmi3Set##Type(fmi3Instance c, const Reference vr[], size_t n, const fmi3##Type value[],           \
                             size_t values)                                                                      \
    {                                                                                                            \
        UNUSED(c), UNUSED(vr), UNUSED(value), UNUSED(values);                                                    \
        return n ? fmi3Error : fmi3OK;                                                                           \
    }

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)

#define REFUSED(name, ...)       \
    fmi3Status name(__VA_ARGS__) \
    {

#define END           \
    return fmi3Error; \
    }

REFUSED(fmi3GetBinary, fmi3Instance c, const Reference vr[], size_t n, size_t sizes[], fmi3Binary value[], size_t m)
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(sizes), UNUSED(value), UNUSED(m);
END

REFUSED(fmi3SetBinary, fmi3Instance c, const Reference vr[], size_t n, const size_t sizes[], const fmi3Binary value[],
        size_t m)
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(sizes), UNUSED(value), UNUSED(m);
END

REFUSED(fmi3GetClock, fmi3Instance c, const Reference vr[], size_t n, fmi3Clock value[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(value);
END

REFUSED(fmi3SetClock, fmi3Instance c, const Reference vr[], size_t n, const fmi3Clock value[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(value);
END

REFUSED(fmi3GetNumberOfVariableDependencies, fmi3Instance c, Reference vr, size_t *n)
    UNUSED(c), UNUSED(vr), UNUSED(n);
END

REFUSED(fmi3GetVariableDependencies, fmi3Instance c, Reference vr, size_t elements[], Reference of[], size_t at[],
        fmi3DependencyKind kinds[], size_t n)
    UNUSED(c), UNUSED(vr), UNUSED(elements), UNUSED(of), UNUSED(at), UNUSED(kinds), UNUSED(n);
END

REFUSED(fmi3GetDirectionalDerivative, fmi3Instance c, const Reference unknown[], size_t unknowns,
        const Reference known[], size_t knowns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t n)
    UNUSED(c), UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns);
    UNUSED(seed), UNUSED(seeds), UNUSED(value), UNUSED(n);
END

REFUSED(fmi3GetAdjointDerivative, fmi3Instance c, const Reference unknown[], size_t unknowns, const Reference known[],
        size_t knowns, const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t n)
    UNUSED(c), UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns);
    UNUSED(seed), UNUSED(seeds), UNUSED(value), UNUSED(n);
END

REFUSED(fmi3EnterConfigurationMode, fmi3Instance c)
    UNUSED(c);
END

REFUSED(fmi3ExitConfigurationMode, fmi3Instance c)
    UNUSED(c);
END

REFUSED(fmi3GetIntervalDecimal, fmi3Instance c, const Reference vr[], size_t n, fmi3Float64 intervals[],
        fmi3IntervalQualifier qualifiers[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(intervals), UNUSED(qualifiers);
END

REFUSED(fmi3GetIntervalFraction, fmi3Instance c, const Reference vr[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions), UNUSED(qualifiers);
END

REFUSED(fmi3GetShiftDecimal, fmi3Instance c, const Reference vr[], size_t n, fmi3Float64 shifts[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(shifts);
END

REFUSED(fmi3GetShiftFraction, fmi3Instance c, const Reference vr[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
END

REFUSED(fmi3SetIntervalDecimal, fmi3Instance c, const Reference vr[], size_t n, const fmi3Float64 intervals[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(intervals);
END

REFUSED(fmi3SetIntervalFraction, fmi3Instance c, const Reference vr[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
END

REFUSED(fmi3SetShiftDecimal, fmi3Instance c, const Reference vr[], size_t n, const fmi3Float64 shifts[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(shifts);
END

REFUSED(fmi3SetShiftFraction, fmi3Instance c, const Reference vr[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
END

REFUSED(fmi3EvaluateDiscreteStates, fmi3Instance c)
    UNUSED(c);
END

REFUSED(fmi3EnterStepMode, fmi3Instance c)
    UNUSED(c);
END

REFUSED(fmi3GetOutputDerivatives, fmi3Instance c, const Reference vr[], size_t n, const fmi3Int32 orders[],
        fmi3Float64 value[], size_t m)
    UNUSED(c), UNUSED(vr), UNUSED(n), UNUSED(orders), UNUSED(value), UNUSED(m);
END

REFUSED(fmi3ActivateModelPartition, fmi3Instance c, Reference clock, fmi3Float64 t)
    UNUSED(c), UNUSED(clock), UNUSED(t);
END

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    UNUSED(name), UNUSED(token), UNUSED(resources), UNUSED(visible), UNUSED(logging);
    UNUSED(environment), UNUSED(log), UNUSED(update), UNUSED(lock), UNUSED(unlock);
    return NULL;
}
