"""A study: many trials or simulations that answer one question, and a report with its statements.

`chapter4` repeats the report's chapter 4, `delay` asks how a delayed wall feels, `approach`
the force before the first touch is known, `excitation` which motion identifies which model, and
the sweeps how noise, speed and change over time move the estimates. A study checks each of its
statements against its own figures. It runs through `batch`; the command line gives it the function
that opens rigs.
"""
