"""The native wrapper: a solver's FMU and a corrector as one new FMU."""
