/* An importer that gives an FMU extreme inputs and steps, and counts the accepted steps. */
#include "fmi3.c"
#include <stdio.h>

int main(void)
{
    const reference out[] = {0, 1, FLEXID_OUTPUTS}, in[] = {FLEXID_OUTPUTS + 1};
    const double values[] = {0.0, 1e300, -1e300, 1e9, 3.0};
    double got[3];
    void *state = NULL;
    bool flag;
    double reached;
    instance *unit = fmi3InstantiateCoSimulation("one", FLEXID_TOKEN, NULL, false, false, false,
                                                 false, NULL, 0, NULL, NULL, NULL);
    int steps = 0;
    if (unit == NULL) {
        return 1;
    }
    (void)fmi3EnterInitializationMode(unit, false, 0.0, 0.0, false, 0.0);
    (void)fmi3ExitInitializationMode(unit);
    for (int n = 0; n < 2000; n++) {
        (void)fmi3SetFloat64(unit, in, 1, &values[n % 5], 1);
        steps += fmi3DoStep(unit, n * 1e-3, 1e-3, true, &flag, &flag, &flag, &reached) == OK;
        if (n == 10) {
            (void)fmi3GetFMUState(unit, &state);
        }
    }
    (void)fmi3DoStep(unit, 0.0, 1e300, true, &flag, &flag, &flag, &reached);
    (void)fmi3DoStep(unit, 0.0, -1.0, true, &flag, &flag, &flag, &reached);
    (void)fmi3DoStep(unit, 0.0, 0.0 * 1e300 / 0.0, true, &flag, &flag, &flag, &reached);
    (void)fmi3SetFMUState(unit, state);
    (void)fmi3FreeFMUState(unit, &state);
    (void)fmi3GetFloat64(unit, out, 3, got, 3);
    (void)fmi3Reset(unit);
    fmi3FreeInstance(unit);
    (void)printf("%d steps\n", steps);
    return 0;
}
