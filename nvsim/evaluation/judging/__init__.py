"""Which of two images of the same view serves an agent better: by models that see, and by figures. The paper's third
table."""
