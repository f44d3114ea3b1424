"""A robot's dynamics in CasADi's symbols."""
