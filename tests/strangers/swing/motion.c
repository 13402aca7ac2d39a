#include <math.h>

#include "swing.h"

double swing_value(const Swing *swing, unsigned reference)
{
    return reference == 0 ? 2.0 * sin(9.0 * swing->time) : 2.0 * cos(9.0 * swing->time);
}
