# SPDX-License-Identifier: Apache-2.0
"""Which model of the noise a record supports: penalised likelihood of its cosine transform."""
