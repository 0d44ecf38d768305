"""The lesions of a comparison: shares found with their intervals, as tables, figures and a part of the page."""
