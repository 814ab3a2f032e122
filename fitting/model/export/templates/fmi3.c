/* FMI 3.0 (Modelica Association, 2022), Model Exchange and Co-Simulation. */
#include "fmi_instance.h"

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                          bool logging, void *environment, void *logger)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    return arm_new(token);
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early, const uint32_t *required, size_t n,
                                         void *environment, void *logger, void *update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)n;
    (void)environment, (void)logger, (void)update;
    return arm_new(token);
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
                                               bool visible, bool logging, void *environment, void *logger,
                                               void *update, void *lock, void *unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}

EXPORT void fmi3FreeInstance(void *c) { free(c); }

EXPORT int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop,
                                       double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return arm_set_time(c, start);
}

EXPORT int fmi3ExitInitializationMode(void *c) { return arm_accepted(c); }
EXPORT int fmi3Reset(void *c) { return arm_reset(c); }
EXPORT int fmi3SetTime(void *c, double time) { return arm_set_time(c, time); }

EXPORT int fmi3GetFloat64(void *c, const uint32_t *vr, size_t n, double *values, size_t count)
{
    return n == count ? arm_get(c, vr, n, values) : ERROR;
}

EXPORT int fmi3SetFloat64(void *c, const uint32_t *vr, size_t n, const double *values, size_t count)
{
    return n == count ? arm_set(c, vr, n, values) : ERROR;
}

EXPORT int fmi3DoStep(void *c, double now, double step, bool no_set_state, bool *events, bool *terminate, bool *early,
                      double *last)
{
    (void)no_set_state;
    *events = *terminate = *early = false;
    *last = now + step;
    return arm_step(c, now, step);
}

EXPORT int fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals, bool *states, bool *defined,
                                    double *next)
{
    (void)c;
    *again = *terminate = *nominals = *states = *defined = false;
    *next = 0;
    return OK;
}

EXPORT int fmi3CompletedIntegratorStep(void *c, bool no_set_state, bool *enter_event_mode, bool *terminate)
{
    (void)no_set_state;
    *enter_event_mode = *terminate = false;
    return arm_accepted(c);
}

EXPORT int fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const *categories)
{
    (void)c, (void)on, (void)n, (void)categories;
    return OK;
}

#define MODE(name) EXPORT int fmi3##name(void *c) { (void)c; return OK; }
MODE(EnterEventMode)
MODE(EnterContinuousTimeMode)
MODE(EnterStepMode)
MODE(EnterConfigurationMode)
MODE(ExitConfigurationMode)
MODE(EvaluateDiscreteStates)
MODE(Terminate)

#define VALUES(name, type) \
    EXPORT int fmi3Get##name(void *c, const uint32_t *vr, size_t n, type *v, size_t count) \
    { (void)c, (void)vr, (void)v; return arm_none(n + count); } \
    EXPORT int fmi3Set##name(void *c, const uint32_t *vr, size_t n, const type *v, size_t count) \
    { (void)c, (void)vr, (void)v; return arm_none(n + count); }
VALUES(Float32, float)
VALUES(Int8, int8_t)
VALUES(UInt8, uint8_t)
VALUES(Int16, int16_t)
VALUES(UInt16, uint16_t)
VALUES(Int32, int32_t)
VALUES(UInt32, uint32_t)
VALUES(Int64, int64_t)
VALUES(UInt64, uint64_t)
VALUES(Boolean, bool)
VALUES(String, char *)

EXPORT int fmi3GetBinary(void *c, const uint32_t *vr, size_t n, size_t *sizes, const uint8_t **v, size_t count)
{
    (void)c, (void)vr, (void)sizes, (void)v;
    return arm_none(n + count);
}

EXPORT int fmi3SetBinary(void *c, const uint32_t *vr, size_t n, const size_t *sizes, const uint8_t *const *v,
                         size_t count)
{
    (void)c, (void)vr, (void)sizes, (void)v;
    return arm_none(n + count);
}

#define CLOCKS(name, type) EXPORT int fmi3##name(void *c, const uint32_t *vr, size_t n, type *v) \
    { (void)c, (void)vr, (void)v; return arm_none(n); }
CLOCKS(GetClock, bool)
CLOCKS(SetClock, const bool)
CLOCKS(GetShiftDecimal, double)
CLOCKS(SetShiftDecimal, const double)
CLOCKS(SetIntervalDecimal, const double)

#define CLOCK_PAIRS(name, first, second) \
    EXPORT int fmi3##name(void *c, const uint32_t *vr, size_t n, first *a, second *b) \
    { (void)c, (void)vr, (void)a, (void)b; return arm_none(n); }
CLOCK_PAIRS(GetIntervalDecimal, double, int)
CLOCK_PAIRS(GetShiftFraction, uint64_t, uint64_t)
CLOCK_PAIRS(SetShiftFraction, const uint64_t, const uint64_t)
CLOCK_PAIRS(SetIntervalFraction, const uint64_t, const uint64_t)

EXPORT int fmi3GetIntervalFraction(void *c, const uint32_t *vr, size_t n, uint64_t *a, uint64_t *b, int *qualifiers)
{
    (void)c, (void)vr, (void)a, (void)b, (void)qualifiers;
    return arm_none(n);
}

#define STATES(name, type) EXPORT int fmi3##name(void *c, type *v, size_t n) { (void)c, (void)v; return arm_none(n); }
STATES(SetContinuousStates, const double)
STATES(GetContinuousStates, double)
STATES(GetContinuousStateDerivatives, double)
STATES(GetEventIndicators, double)
STATES(GetNominalsOfContinuousStates, double)

#define NONE(name) EXPORT int fmi3##name(void *c, size_t *count) { (void)c; *count = 0; return OK; }
NONE(GetNumberOfEventIndicators)
NONE(GetNumberOfContinuousStates)

EXPORT int fmi3GetFMUState(void *c, void **state) { (void)c, (void)state; return ERROR; }
EXPORT int fmi3SetFMUState(void *c, void *state) { (void)c, (void)state; return ERROR; }
EXPORT int fmi3FreeFMUState(void *c, void **state) { (void)c, (void)state; return ERROR; }

EXPORT int fmi3SerializedFMUStateSize(void *c, void *state, size_t *size)
{
    (void)c, (void)state, (void)size;
    return ERROR;
}

EXPORT int fmi3SerializeFMUState(void *c, void *state, uint8_t *bytes, size_t size)
{
    (void)c, (void)state, (void)bytes, (void)size;
    return ERROR;
}

EXPORT int fmi3DeserializeFMUState(void *c, const uint8_t *bytes, size_t size, void **state)
{
    (void)c, (void)bytes, (void)size, (void)state;
    return ERROR;
}

#define DERIVATIVE(name) \
    EXPORT int fmi3##name(void *c, const uint32_t *unknowns, size_t n, const uint32_t *knowns, size_t m, \
                          const double *seed, size_t seeds, double *sensitivity, size_t count) \
    { (void)c, (void)unknowns, (void)n, (void)knowns, (void)m, (void)seed, (void)seeds, (void)sensitivity, \
      (void)count; return ERROR; }
DERIVATIVE(GetDirectionalDerivative)
DERIVATIVE(GetAdjointDerivative)

EXPORT int fmi3GetOutputDerivatives(void *c, const uint32_t *vr, size_t n, const int32_t *orders, double *v,
                                    size_t count)
{
    (void)c, (void)vr, (void)orders, (void)v;
    return arm_none(n + count);
}

EXPORT int fmi3GetNumberOfVariableDependencies(void *c, uint32_t vr, size_t *count)
{
    (void)c, (void)vr, (void)count;
    return ERROR;
}

EXPORT int fmi3GetVariableDependencies(void *c, uint32_t dependent, size_t *of, uint32_t *independents,
                                       size_t *indices, int *kinds, size_t n)
{
    (void)c, (void)dependent, (void)of, (void)independents, (void)indices, (void)kinds, (void)n;
    return ERROR;
}

EXPORT int fmi3ActivateModelPartition(void *c, uint32_t clock, double time)
{
    (void)c, (void)clock, (void)time;
    return ERROR;
}
