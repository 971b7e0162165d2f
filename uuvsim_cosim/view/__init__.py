"""What a person looks at: figures of merit, plots, the one-file report and block diagrams."""
