# SPDX-License-Identifier: Apache-2.0
"""Recording a bench or what others publish: started, shown, stopped, and judged."""
