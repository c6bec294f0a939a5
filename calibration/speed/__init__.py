"""Speed against error: the routes of this library and what one would write instead."""
