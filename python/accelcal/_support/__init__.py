"""Support: threads of the linear algebra, results shown in a notebook, missing extras."""
