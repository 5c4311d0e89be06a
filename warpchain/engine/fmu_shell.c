/* Shell of an exported drive: FMI 3.0 co-simulation around the object code of the CPU's kernel.

   The image is one block of memory with all that a launch of the kernel reads and writes: its bounds and arguments, the
   arrays that these point to, and the scratch, which a launch need not find as the last one left it. drive.h, written
   beside this file at an export, says where they stand. Offsets are in bytes from the image's begin. Step n evaluates
   the forces at t = n h and moves everything on to t + h. */
#define _GNU_SOURCE
#include <cpuid.h>
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Of the FMI standard 3.0, as far as it is needed here. */
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef uint32_t fmi3ValueReference;
typedef void (*LogMessage)(void *environment, fmi3Status status, const char *category, const char *message);

/* A drive's own table over time: `spacing` apart, from `first` on among the image's tables. */
typedef struct {
    int cells, first, repeats;
    double start, spacing;
} Table;

/* Table as kernels read it in the rows of the image, `kernels.structs.Tabulated`. */
typedef struct {
    int32_t cells, first, over_angle, repeats;
    double start, spacing;
} Row;

typedef enum { HELD, SPEED, LED, NUMBER } Kind;

/* An input: where it is written, and the drive's own motion until it is set (`warpchain.engine.input_ports`). */
typedef struct {
    const char *name;
    Kind kind;
    double least;
    int axes, value, rows; /* its number of values, the first of them, the rows that have it */
    int places[2];         /* its tables, by axis, among the image's */
    const long *tables;    /* (rows, axes) offsets */
    const long *replaced;  /* (rows,) offsets of the numbers that it stands in for, or is */
    double beside;         /* these numbers beside it */
    double home[2];        /* of what is led [m] */
    Table own[2];
    double speed, ramp_time; /* of an own speed [rad/s], [s] */
    double offset, amplitude, frequency, phase, direction[2]; /* of an own motion of a center */
} Input;

typedef struct {
    long at, to;
} Pointer;

#include "drive.h"

_Static_assert(sizeof(Row) == ROW_BYTES, "a table is not as kernels have it");

/* Image of the state after assembly and settling, without scratch. */
__asm__(".section .rodata\n.balign 64\n"
        ".global image_at_start\n.hidden image_at_start\nimage_at_start:\n.incbin \"" IMAGE_FILE "\"\n.previous\n");
extern const char image_at_start[] __attribute__((visibility("hidden")));

extern void KERNEL(void *bounds, void *arguments);

/* An input over time: from `before` to `after`, between `start` and `end`, as `input_ports.InputPort`. */
typedef struct {
    double before[2], after[2], pace[2], start, end, turned;
    bool is_set;
} Path;

/* What belongs to a state beside the image. */
typedef struct {
    char token[64];
    double values[VALUES + 1];
    bool given[INPUTS + 1], fresh[INPUTS + 1]; /* ever set; set since the last piece */
    Path paths[INPUTS + 1];
    double start_time;
    int32_t taken; /* step up to which all is evaluated, -1 before the first */
    bool is_ready; /* initialized, and not terminated */
    bool is_early; /* the start was evaluated for its outputs, before the first piece */
} Kept;

typedef struct {
    Kept kept;
    void *environment;
    LogMessage log;
    char *image;
} Instance;

static fmi3Status fail(Instance *of, const char *format, ...)
{
    char line[400];
    va_list rest;
    va_start(rest, format);
    vsnprintf(line, sizeof line, format, rest);
    va_end(rest);
    if (of && of->log)
        of->log(of->environment, fmi3Error, "logStatusError", line);
    return fmi3Error;
}

static int32_t *progress(Instance *of) { return (int32_t *)(of->image + PROGRESS); }
static bool has_diverged(Instance *of) { return progress(of)[1] != 0; }
static double now(const Instance *of) { return fmax(of->kept.taken, 0) * STEP; }

/* Sets the image's pointers; of an image that is kept, to null. */
static void set_pointers(char *image, bool is_kept)
{
    for (size_t i = 0; i < sizeof POINTERS / sizeof *POINTERS; ++i)
        *(uint64_t *)(image + POINTERS[i].at) = is_kept ? 0 : (uint64_t)(uintptr_t)(image + POINTERS[i].to);
}

/* Takes all back to the state after settling; of the inputs only that they were set is left. */
static void rewind_image(Instance *of)
{
    memcpy(of->image, image_at_start, KEPT_BYTES);
    set_pointers(of->image, false);
    memset(of->kept.paths, 0, sizeof of->kept.paths);
    for (int i = 0; i < INPUTS; ++i)
        of->kept.paths[i].end = 1.0;
    memcpy(of->kept.fresh, of->kept.given, sizeof of->kept.fresh);
    of->kept.taken = -1;
    of->kept.is_early = false;
}

static void reset(Instance *of)
{
    memset(&of->kept, 0, sizeof of->kept);
    strncpy(of->kept.token, TOKEN, sizeof of->kept.token - 1);
    for (int i = 0; i < VALUES; ++i)
        of->kept.values[i] = STARTS[i];
    rewind_image(of);
}

/* Value, slope and integral of a table, as `kernels.physics.motion`; 0 of none. */
static void read_table(const double *tables, const Table *table, double x, double found[3])
{
    found[0] = found[1] = found[2] = 0.0;
    if (!table->cells)
        return;
    double u = (x - table->start) / table->spacing;
    double rounds = table->repeats ? floor(u / table->cells) : 0.0;
    u -= rounds * table->cells;
    double within = fmin(fmax(u, 0.0), table->cells);
    int cell = (int)fmin(within, table->cells - 1);
    const double *c = tables + table->first + CELL * cell;
    double w = within - cell, beyond = u - within;
    found[0] = c[0] + w * (c[1] + w * (c[2] + w * c[3]));
    found[1] = beyond == 0.0 ? (c[1] + w * (2.0 * c[2] + w * 3.0 * c[3])) / table->spacing : 0.0;
    found[2] = c[4] + table->spacing * w * (c[0] + w * (c[1] / 2 + w * (c[2] / 3 + w * c[3] / 4)))
             + beyond * table->spacing * found[0];
    if (rounds != 0.0)
        found[2] += rounds * tables[table->first + CELL * table->cells];
}

/* Angle phi that a prescribed body has turned at `time`, without harmonics [rad]. */
static double turned_angle(const Input *input, const Path *path, const double *tables, double time)
{
    if (path->is_set) {
        double w = fmin(fmax(time, 0.0), 1.0), first = path->before[0], last = path->after[0];
        return path->turned + w * (first + 0.5 * (last - first) * w) + (time - w) * last;
    }
    if (input->own[0].cells) {
        double found[3];
        read_table(tables, &input->own[0], time, found);
        return found[2];
    }
    double u = input->ramp_time > 0.0 ? fmin(time / input->ramp_time, 1.0) : 1.0;
    double ramped = u < 1.0 ? input->ramp_time * (u * u * u) * (1.0 - 0.5 * u) : time - 0.5 * input->ramp_time;
    return input->speed * ramped;
}

/* Displacement [m] and velocity [m/s] of what is led, along one axis. */
static void led_motion(const Input *input, const Path *path, const double *tables, double time, int k, double found[2])
{
    if (path->is_set) {
        double span = path->end - path->start, u = (time - path->start) / span;
        double w = fmin(fmax(u, 0.0), 1.0), way = path->after[k] - path->before[k], c1 = path->pace[k];
        double c2 = 3.0 * way - 2.0 * c1, c3 = c1 - 2.0 * way;
        found[0] = path->before[k] + w * (c1 + w * (c2 + w * c3));
        found[1] = u < 1.0 ? (c1 + w * (2.0 * c2 + w * 3.0 * c3)) / span : 0.0;
    } else if (input->own[0].cells || input->own[1].cells) {
        double of_table[3];
        read_table(tables, &input->own[k], time, of_table);
        found[0] = of_table[0], found[1] = of_table[1];
    } else {
        double argument = input->frequency * time + input->phase;
        found[0] = (input->offset + input->amplitude * sin(argument)) * input->direction[k];
        found[1] = input->amplitude * input->frequency * cos(argument) * input->direction[k];
    }
}

/* Writes an input into the image, from the next step on; what is led gets there within `piece` [s]. */
static void apply_input(Instance *of, int i, double piece)
{
    const Input *input = &INPUT_TABLE[i];
    Path *path = &of->kept.paths[i], next = *path;
    double *tables = (double *)(of->image + TABLES), time = (of->kept.taken + 1) * STEP;
    bool is_led = input->kind == LED;
    next.start = is_led ? time : 0.0;
    next.end = is_led ? now(of) + fmax(piece, 2.0 * STEP) : 1.0;
    for (int k = 0; k < input->axes; ++k) {
        next.after[k] = of->kept.values[input->value + k] - input->home[k];
        next.before[k] = next.after[k];
        if (is_led) {
            double here[2];
            led_motion(input, path, tables, time, k, here);
            next.before[k] = here[0];
            next.pace[k] = here[1] * (next.end - time);
        }
    }
    if (!is_led && path->is_set && path->after[0] == next.after[0])
        return;
    if (input->kind == SPEED)
        next.turned = turned_angle(input, path, tables, time) - next.after[0] * time;
    next.is_set = true;
    *path = next;
    for (int r = 0; r < input->rows; ++r) {
        if (input->replaced)
            *(double *)(of->image + input->replaced[r]) = input->kind == NUMBER ? next.after[0] : input->beside;
        for (int k = 0; k < input->axes && input->kind != NUMBER; ++k) {
            Row row = {1, input->places[k], 0, 0, next.start, next.end - next.start};
            memcpy(of->image + input->tables[r * input->axes + k], &row, sizeof row);
        }
    }
    for (int k = 0; k < input->axes && input->kind != NUMBER; ++k) {
        double way = next.after[k] - next.before[k], pace = next.pace[k];
        double cell[CELL] = {next.before[k], way, 0.0, 0.0, next.turned};
        if (is_led)
            cell[1] = pace, cell[2] = 3.0 * way - 2.0 * pace, cell[3] = pace - 2.0 * way;
        memcpy(tables + input->places[k], cell, sizeof cell);
    }
}

/* Evaluates all up to step `until`, with a frame of the last. */
static void take_steps(Instance *of, int32_t until)
{
    int32_t count = until - of->kept.taken, every = until % count == 0 ? count : until;
    for (int r = 0; r < DRIVES; ++r)
        *(int32_t *)(of->image + FRAME_INTERVAL + r * DRIVE_BYTES) = every > 1 ? every : 1;
    *(int32_t *)(of->image + STEPS) = count;
    KERNEL(of->image, of->image + ARGUMENTS);
    of->kept.taken = until;
}

/* Evaluates the start, unless that is done; `piece` [s] is 0 where only its outputs are wanted. */
static void begin(Instance *of, double piece)
{
    bool is_changed = false;
    for (int i = 0; i < INPUTS; ++i)
        is_changed |= of->kept.fresh[i];
    if (of->kept.is_early && is_changed)
        rewind_image(of);
    for (int i = 0; i < INPUTS; ++i)
        if (of->kept.fresh[i] && (piece > 0.0 || (of->kept.taken < 0 && INPUT_TABLE[i].kind != LED))) {
            apply_input(of, i, piece);
            of->kept.fresh[i] = false;
        }
    if (of->kept.taken < 0) {
        take_steps(of, 0);
        of->kept.is_early = piece == 0.0;
    }
    if (piece > 0.0)
        of->kept.is_early = false;
}

static fmi3Status diverged(Instance *of)
{
    return fail(of, "diverged at t = %.6g s: a roller or a body has left the drive, or a link is torn; "
                    "reset, or go back to a state before", of->kept.start_time + progress(of)[0] * STEP);
}

#define EXPORT __attribute__((visibility("default")))

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *instance, bool is_on, size_t count, const char *const categories[])
{
    (void)instance, (void)is_on, (void)count, (void)categories;
    return fmi3OK;
}

/* Whether the processor has the instructions of the kernel's object code. */
static bool has_instructions(void)
{
    unsigned int a, b, c, d, first;
    if (!__get_cpuid(1, &a, &b, &first, &d) || !__get_cpuid_count(7, 0, &a, &b, &c, &d))
        return false;
    return (first & bit_FMA) && (first & bit_OSXSAVE) && (b & bit_AVX2) && (b & bit_BMI2);
}

EXPORT void *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool is_visible, bool is_logging, bool uses_events,
    bool returns_early, const fmi3ValueReference wanted[], size_t count, void *environment, LogMessage log,
    void *intermediate_update)
{
    (void)name, (void)resources, (void)is_visible, (void)is_logging, (void)uses_events;
    (void)returns_early, (void)wanted, (void)count, (void)intermediate_update;
    Instance *of = calloc(1, sizeof *of);
    if (!of)
        return NULL;
    of->environment = environment, of->log = log;
    const char *lacking = NULL;
    if (!token || strcmp(token, TOKEN))
        lacking = "the instantiation token is of another FMU";
    else if (!has_instructions())
        lacking = "needs a processor with AVX2, FMA and BMI2 (x86-64-v3)";
    else if (!(of->image = aligned_alloc(64, IMAGE_BYTES)))
        lacking = "no memory is left";
    if (lacking) {
        fail(of, "%s", lacking);
        free(of);
        return NULL;
    }
    memset(of->image, 0, IMAGE_BYTES);
    reset(of);
    return of;
}

EXPORT void fmi3FreeInstance(void *instance)
{
    Instance *of = instance;
    if (of) {
        free(of->image);
        free(of);
    }
}

EXPORT fmi3Status fmi3EnterInitializationMode(
    void *instance, bool has_tolerance, double tolerance, double start_time, bool has_stop_time, double stop_time)
{
    Instance *of = instance;
    (void)has_tolerance, (void)tolerance, (void)has_stop_time, (void)stop_time;
    if (!isfinite(start_time))
        return fail(of, "start time: must be a finite number");
    of->kept.start_time = start_time;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *instance)
{
    ((Instance *)instance)->kept.is_ready = true;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(void *instance)
{
    reset(instance);
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(void *instance)
{
    ((Instance *)instance)->kept.is_ready = false;
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(
    void *instance, double point, double size, bool no_earlier_state, bool *needs_event, bool *terminates,
    bool *is_early, double *last_time)
{
    Instance *of = instance;
    (void)no_earlier_state;
    *needs_event = *terminates = *is_early = false;
    double from = point - of->kept.start_time, target = from + size;
    *last_time = of->kept.start_time + now(of);
    if (!of->kept.is_ready)
        return fail(of, "doStep: needs an instance that is initialized and not terminated");
    if (!(size > 0.0) || !isfinite(target))
        return fail(of, "doStep: a step size of %g s: must be a finite number above 0", size);
    if (fabs(from - now(of)) > STEP)
        return fail(of, "doStep: from t = %.9g s, but the drive stands at %.9g s", point, *last_time);
    if (target > MOST_STEPS * STEP)
        return fail(of, "doStep: to t = %g s: it counts steps up to %g s", point + size, MOST_STEPS * STEP);
    if (has_diverged(of))
        return diverged(of);
    begin(of, size);
    int32_t until = (int32_t)(target / STEP + 0.5);
    if (until > of->kept.taken)
        take_steps(of, until);
    if (has_diverged(of)) {
        *last_time = of->kept.start_time + progress(of)[0] * STEP;
        return diverged(of);
    }
    *last_time = point + size;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(
    void *instance, const fmi3ValueReference which[], size_t count, double values[], size_t length)
{
    Instance *of = instance;
    if (length != count)
        return fail(of, "getFloat64: %zu values for %zu variables; all are scalars", length, count);
    for (size_t i = 0; i < count; ++i) {
        if (which[i] > VALUES + OUTPUTS)
            return fail(of, "getFloat64: there is no variable %u", which[i]);
        if (which[i] == 0)
            values[i] = of->kept.start_time + now(of);
        else if (which[i] <= VALUES)
            values[i] = of->kept.values[which[i] - 1];
        else {
            if (of->kept.taken < 0 || of->kept.is_early)
                begin(of, 0.0);
            double value = ((const double *)(of->image + FRAMES))[OUTPUT_PLACES[which[i] - VALUES - 1]];
            values[i] = has_diverged(of) ? NAN : value;
        }
    }
    return fmi3OK;
}

static int input_of_value(unsigned int value)
{
    int i = 0;
    while (i + 1 < INPUTS && INPUT_TABLE[i + 1].value <= (int)value)
        ++i;
    return i;
}

EXPORT fmi3Status fmi3SetFloat64(
    void *instance, const fmi3ValueReference which[], size_t count, const double values[], size_t length)
{
    Instance *of = instance;
    if (length != count)
        return fail(of, "setFloat64: %zu values for %zu variables; all are scalars", length, count);
    for (size_t n = 0; n < count; ++n) {
        if (which[n] == 0 || which[n] > VALUES)
            return fail(of, "setFloat64: variable %u is no input", which[n]);
        int i = input_of_value(which[n] - 1);
        const Input *input = &INPUT_TABLE[i];
        if (!isfinite(values[n]) || values[n] < input->least)
            return fail(of, "%s = %g: must be a finite number, at least %g", input->name, values[n], input->least);
        of->kept.values[which[n] - 1] = values[n];
        of->kept.given[i] = of->kept.fresh[i] = true;
    }
    return fmi3OK;
}

enum { STATE_BYTES = sizeof(Kept) + KEPT_BYTES };

EXPORT fmi3Status fmi3GetFMUState(void *instance, void **state)
{
    Instance *of = instance;
    if (!*state && !(*state = malloc(STATE_BYTES)))
        return fail(of, "getFMUState: no memory is left");
    memcpy(*state, &of->kept, sizeof of->kept);
    memcpy((char *)*state + sizeof of->kept, of->image, KEPT_BYTES);
    set_pointers((char *)*state + sizeof of->kept, true);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(void *instance, void *state)
{
    Instance *of = instance;
    if (!state)
        return fail(of, "setFMUState: there is no state");
    memcpy(&of->kept, state, sizeof of->kept);
    memcpy(of->image, (const char *)state + sizeof of->kept, KEPT_BYTES);
    set_pointers(of->image, false);
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(void *instance, void **state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(void *instance, void *state, size_t *size)
{
    (void)instance, (void)state;
    *size = STATE_BYTES;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(void *instance, void *state, uint8_t bytes[], size_t size)
{
    if (!state || size != STATE_BYTES)
        return fail(instance, "serializeFMUState: of %zu bytes; it has %zu", size, (size_t)STATE_BYTES);
    memcpy(bytes, state, STATE_BYTES);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(void *instance, const uint8_t bytes[], size_t size, void **state)
{
    if (size != STATE_BYTES || strncmp((const char *)bytes, TOKEN, sizeof((Kept *)0)->token))
        return fail(instance, "deserializeFMUState: these bytes are no state of this FMU");
    if (!*state && !(*state = malloc(STATE_BYTES)))
        return fail(instance, "deserializeFMUState: no memory is left");
    memcpy(*state, bytes, STATE_BYTES);
    return fmi3OK;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(
    void *instance, bool *needs_update, bool *terminates, bool *nominals_changed, bool *values_changed,
    bool *has_next_event, double *next_event)
{
    (void)instance;
    *needs_update = *terminates = *nominals_changed = *values_changed = *has_next_event = false;
    *next_event = 0.0;
    return fmi3OK;
}

/* Functions whose call is right only for variables of a type, of which there are none. */
#define WITHOUT_VARIABLES(name)                                                            \
    EXPORT fmi3Status name(void *instance, const fmi3ValueReference which[], size_t count) \
    {                                                                                      \
        (void)which;                                                                       \
        return count ? fail(instance, #name ": all variables are Float64") : fmi3OK;       \
    }
#define OF_TYPE(type) WITHOUT_VARIABLES(fmi3Get##type) WITHOUT_VARIABLES(fmi3Set##type)
OF_TYPE(Float32)
OF_TYPE(Int8)
OF_TYPE(UInt8)
OF_TYPE(Int16)
OF_TYPE(UInt16)
OF_TYPE(Int32)
OF_TYPE(UInt32)
OF_TYPE(Int64)
OF_TYPE(UInt64)
OF_TYPE(Boolean)
OF_TYPE(String)
OF_TYPE(Binary)
OF_TYPE(Clock)
OF_TYPE(IntervalDecimal)
OF_TYPE(IntervalFraction)
OF_TYPE(ShiftDecimal)
OF_TYPE(ShiftFraction)
WITHOUT_VARIABLES(fmi3GetOutputDerivatives)

/* Functions of what modelDescription.xml says it has not. */
#define REFUSED(name) \
    EXPORT fmi3Status name(void *instance) { return fail(instance, #name ": is not provided"); }
REFUSED(fmi3EnterEventMode)
REFUSED(fmi3EnterStepMode)
REFUSED(fmi3EnterConfigurationMode)
REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3EvaluateDiscreteStates)
REFUSED(fmi3GetNumberOfVariableDependencies)
REFUSED(fmi3GetVariableDependencies)
REFUSED(fmi3GetDirectionalDerivative)
REFUSED(fmi3GetAdjointDerivative)
REFUSED(fmi3EnterContinuousTimeMode)
REFUSED(fmi3CompletedIntegratorStep)
REFUSED(fmi3SetTime)
REFUSED(fmi3SetContinuousStates)
REFUSED(fmi3GetContinuousStateDerivatives)
REFUSED(fmi3GetEventIndicators)
REFUSED(fmi3GetContinuousStates)
REFUSED(fmi3GetNominalsOfContinuousStates)
REFUSED(fmi3GetNumberOfEventIndicators)
REFUSED(fmi3GetNumberOfContinuousStates)
REFUSED(fmi3ActivateModelPartition)

EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }

/* Of Warp, which kernels call. */
int _wp_isfinite(double value) { return isfinite(value); }
int _wp_isnan(double value) { return isnan(value); }
int _wp_isinf(double value) { return isinf(value); }
