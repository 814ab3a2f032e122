"""Mistakes of people: units, signs, cables, clocks, sizes, roles; found in recordings and reported with the cure.

Nothing is corrected. Start at :mod:`fitting.checks.check`; the findings are listed in ``docs/checks.md``.

========================  ===========================================================================
findings                  what is reported
reading                   recordings as far as they can be read
signal_faults, time_axis  one channel, one clock alone
magnitudes                numbers that no machine has
motions                   recordings against one another, and their first seconds
two_sensors               joint against piston position
samples, physical         the best arm that could exist, and what it leaves unexplained
trials, estimates         mistakes, and effects like them, that would explain it if they were taken back
check                     all of it in order, and the root of what was found
========================  ===========================================================================
"""
