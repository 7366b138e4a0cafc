"""Comparing pipelines: suites, the runner, truth and metrics, the report.

Nothing is imported here; a program that only reads a suite does not pay for drawing or plotting.
"""
