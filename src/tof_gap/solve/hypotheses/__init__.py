"""What may explain the error: named effects in every form, errors without a name, and their columns."""
