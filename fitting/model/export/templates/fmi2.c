/* FMI 2.0 (Modelica Association, 2014), Model Exchange and Co-Simulation. */
#include "fmi_instance.h"

typedef struct {
    int newDiscreteStatesNeeded, terminateSimulation, nominalsChanged, valuesChanged, nextEventTimeDefined;
    double nextEventTime;
} EventInfo;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const void *functions, int visible, int logging)
{
    (void)name, (void)type, (void)resources, (void)functions, (void)visible, (void)logging;
    return arm_new(guid);
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }

EXPORT int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return arm_set_time(c, start);
}

EXPORT int fmi2ExitInitializationMode(void *c) { return arm_accepted(c); }
EXPORT int fmi2Reset(void *c) { return arm_reset(c); }
EXPORT int fmi2SetTime(void *c, double time) { return arm_set_time(c, time); }

EXPORT int fmi2GetReal(void *c, const unsigned int *vr, size_t n, double *values) { return arm_get(c, vr, n, values); }

EXPORT int fmi2SetReal(void *c, const unsigned int *vr, size_t n, const double *values)
{
    return arm_set(c, vr, n, values);
}

EXPORT int fmi2DoStep(void *c, double now, double step, int no_set_state)
{
    (void)no_set_state;
    return arm_step(c, now, step);
}

EXPORT int fmi2NewDiscreteStates(void *c, EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return OK;
}

EXPORT int fmi2CompletedIntegratorStep(void *c, int no_set_state, int *enter_event_mode, int *terminate)
{
    (void)no_set_state;
    *enter_event_mode = *terminate = 0;
    return arm_accepted(c);
}

EXPORT int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *categories)
{
    (void)c, (void)on, (void)n, (void)categories;
    return OK;
}

#define MODE(name) EXPORT int fmi2##name(void *c) { (void)c; return OK; }
MODE(EnterInitializationMode)
MODE(EnterEventMode)
MODE(EnterContinuousTimeMode)
MODE(Terminate)

#define VALUES(name, type) \
    EXPORT int fmi2Get##name(void *c, const unsigned int *vr, size_t n, type *v) \
    { (void)c, (void)vr, (void)v; return arm_none(n); } \
    EXPORT int fmi2Set##name(void *c, const unsigned int *vr, size_t n, const type *v) \
    { (void)c, (void)vr, (void)v; return arm_none(n); }
VALUES(Integer, int)
VALUES(Boolean, int)
VALUES(String, char *)

#define STATES(name, type) EXPORT int fmi2##name(void *c, type *v, size_t n) { (void)c, (void)v; return arm_none(n); }
STATES(SetContinuousStates, const double)
STATES(GetContinuousStates, double)
STATES(GetDerivatives, double)
STATES(GetEventIndicators, double)
STATES(GetNominalsOfContinuousStates, double)

#define STATUS(name, type) EXPORT int fmi2Get##name(void *c, int kind, type *v) \
    { (void)c, (void)kind, (void)v; return ERROR; }
STATUS(Status, int)
STATUS(RealStatus, double)
STATUS(IntegerStatus, int)
STATUS(BooleanStatus, int)
STATUS(StringStatus, char *)

EXPORT int fmi2CancelStep(void *c) { (void)c; return ERROR; }
EXPORT int fmi2GetFMUstate(void *c, void **state) { (void)c, (void)state; return ERROR; }
EXPORT int fmi2SetFMUstate(void *c, void *state) { (void)c, (void)state; return ERROR; }
EXPORT int fmi2FreeFMUstate(void *c, void **state) { (void)c, (void)state; return ERROR; }

EXPORT int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    (void)c, (void)state, (void)size;
    return ERROR;
}

EXPORT int fmi2SerializeFMUstate(void *c, void *state, char *bytes, size_t size)
{
    (void)c, (void)state, (void)bytes, (void)size;
    return ERROR;
}

EXPORT int fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t size, void **state)
{
    (void)c, (void)bytes, (void)size, (void)state;
    return ERROR;
}

EXPORT int fmi2GetDirectionalDerivative(void *c, const unsigned int *unknowns, size_t n, const unsigned int *knowns,
                                        size_t m, const double *seed, double *sensitivity)
{
    (void)c, (void)unknowns, (void)n, (void)knowns, (void)m, (void)seed, (void)sensitivity;
    return ERROR;
}

EXPORT int fmi2SetRealInputDerivatives(void *c, const unsigned int *vr, size_t n, const int *order, const double *v)
{
    (void)c, (void)vr, (void)order, (void)v;
    return arm_none(n);
}

EXPORT int fmi2GetRealOutputDerivatives(void *c, const unsigned int *vr, size_t n, const int *order, double *v)
{
    (void)c, (void)vr, (void)order, (void)v;
    return arm_none(n);
}
