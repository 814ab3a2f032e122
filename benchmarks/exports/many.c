/* Calls the exported inverse dynamics again and again, so that a call from Python is none of what is timed. */
#include "model.h"

double many(const double *rows, int count, int times);
double many(const double *rows, int count, int times)
{
    double tau[JOINTS], sum = 0;
    int k;
    for (k = 0; k < times; ++k) {
        const double *row = rows + (k % count) * 3 * JOINTS;
        INVERSE_DYNAMICS(row, row + JOINTS, row + 2 * JOINTS, 0.0, tau);
        sum += tau[0];
    }
    return sum;
}
