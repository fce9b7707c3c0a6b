/* test_vector.h: samples, and the estimates of flexid in Python from them; generated. */
#ifndef TEST_VECTOR_H
#define TEST_VECTOR_H

#include "flexid_drive.h"

#define N_SAMPLES {{ samples | length }}U
#define N_CHECKS {{ checks | length }}U

#if defined(FLEXID_FLOAT)
#define V(x) (x##f)
#else
#define V(x) (x)
#endif

/* {{ drive.sample_names | join(", ") }} */
static const flexid_sample SAMPLES[N_SAMPLES] = {
%% for sample in samples
    { {{- sample | map("value") | join(", ") -}} },
%% endfor
};

/* Largest magnitude of each estimate, to which differences are relative. */
static const double SCALE[FLEXID_COEFFICIENTS] = { {{- scale | join(", ") -}} };

/* Allowed difference of each estimate, relative to SCALE. It exceeds {{ "%g" % least.double }}
 * (double) and {{ "%g" % least.float }} (float) only for an estimate that is sensitive to rounded
 * samples, for example one near zero. */
static const double ALLOWED[FLEXID_COEFFICIENTS] = {
#if defined(FLEXID_FLOAT)
    {{ allowed.float | join(", ") }}
#else
    {{ allowed.double | join(", ") }}
#endif
};

/* Estimates after some samples: {{ drive.system.coefficients | join(", ") }} */
static const struct {
    unsigned sample;
    double values[FLEXID_COEFFICIENTS];
} CHECKS[N_CHECKS] = {
%% for place, estimates in checks
    { {{- place }}U, { {{- estimates | join(", ") -}} }},
%% endfor
};

#endif /* TEST_VECTOR_H */
