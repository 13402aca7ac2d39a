/* A simulation's rows through the corrector, with nothing but C and the generated sources.
 *
 *     correct SPEED AMPLITUDE FREQUENCY START < run.csv > corrected.csv
 *
 * km/h, deg, Hz, and the s at which the excitation begins. run.csv: time in s, then the corrector's channels and what else it
 * sees, in their order and units, at its sample time; columns behind them are not read. Status: 0 corrected, 1 the window is not full
 * yet, 2 outside of what the corrector was trained on. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "corrector.h"
#include "network.h"

enum { ROWS = NETWORK_ROWS, SEEN = NETWORK_SEEN, CHANNELS = NETWORK_CHANNELS, OK = 0, WARMUP = 1, OUTSIDE = 2 };

static void stop(long line, const char *message)
{
    fprintf(stderr, "line %ld: %s\n", line, message);
    exit(1);
}

/* The next cell of a line, which must be a finite number and be followed by a comma or the line's end. */
static double cell(char **at, long line)
{
    char *end;
    const double value = strtod(*at, &end);
    if (end == *at || !isfinite(value) || !strchr(",\r\n", *end))
        stop(line, "expected a finite number for the time and for each channel");
    *at = end + (*end == ',');
    return value;
}

int main(int argc, char *argv[])
{
    static char text[1 << 16];
    static float window[ROWS * SEEN]; /* oldest row first */
    static float states[2][NETWORK_STATE + 1]; /* what it remembers; a network without a state does not look at it */
    static const double uncorrected[CHANNELS] = CORRECTOR_UNCORRECTED;
    double settings[4]; /* speed, amplitude, frequency, start */
    if (argc != 5) {
        fprintf(stderr, "usage: %s SPEED AMPLITUDE FREQUENCY START < run.csv > corrected.csv\n", argv[0]);
        return 2;
    }
    for (int i = 0; i < 4; i++) {
        char *end;
        settings[i] = strtod(argv[i + 1], &end);
        if (end == argv[i + 1] || *end || !isfinite(settings[i])) {
            fprintf(stderr, "%s is no finite number\n", argv[i + 1]);
            return 2;
        }
    }
    const float condition[3] = {(float)settings[0], (float)settings[1], (float)settings[2]};
    const long long start = llround(settings[3] * 1e9);

    const size_t length = strlen(CORRECTOR_INPUT);
    if (!fgets(text, sizeof text, stdin) || strncmp(text, CORRECTOR_INPUT, length) || !strchr(",\r\n", text[length]))
        stop(1, "expected the columns " CORRECTOR_INPUT);
    puts(CORRECTOR_OUTPUT);

    long long last = 0; /* times are whole nanoseconds */
    for (long line = 2, rows = 0; fgets(text, sizeof text, stdin); line++) {
        if (!strchr(text, '\n'))
            stop(line, "the line is cut off, or too long");
        char *at = text;
        double seen[SEEN];
        const long long now = llround(cell(&at, line) * 1e9);
        if (rows && now - last != CORRECTOR_STEP_NS)
            stop(line, "the time does not follow at the corrector's sample time");
        last = now;
        memmove(window, window + SEEN, (ROWS - 1) * SEEN * sizeof *window);
        float *newest = window + (ROWS - 1) * SEEN;
        for (int j = 0; j < SEEN; j++)
            newest[j] = (float)(seen[j] = cell(&at, line));

        int status = WARMUP;
        double delta[CHANNELS] = {0}, spread[CHANNELS];
        memcpy(spread, uncorrected, sizeof spread);
        if (++rows >= ROWS) {
            float corrected[CHANNELS], baseline[CHANNELS], sigma[CHANNELS], inside;
            network(window, condition, (double)(now - start) / 1e9, corrected, baseline, sigma, &inside, states[rows % 2],
                    states[(rows + 1) % 2]);
            for (int j = 0; j < CHANNELS; j++) {
                delta[j] = corrected[j] - newest[j];
                spread[j] = sigma[j];
            }
            status = inside >= 1.0f ? OK : OUTSIDE;
        }

        printf("%.9f", (double)now / 1e9);
        for (int j = 0; j < CHANNELS; j++)
            printf(",%.9g", seen[j] + delta[j]);
        for (int j = 0; j < CHANNELS; j++)
            printf(",%.9g", spread[j]);
        printf(",%d\n", status);
    }
    if (ferror(stdin) || fflush(stdout)) {
        perror("correct");
        return 1;
    }
    return 0;
}
