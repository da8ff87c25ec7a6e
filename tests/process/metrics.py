"""Reads OpenMetrics text on stdin as strictly as the standard has it, and prints how many samples it holds."""

import sys

from prometheus_client.openmetrics.parser import text_string_to_metric_families

families = list(text_string_to_metric_families(sys.stdin.read()))
print(sum(len(family.samples) for family in families))
