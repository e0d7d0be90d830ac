"""Two sessions compared: which effects a simulator lacks, exaggerates or adds."""
