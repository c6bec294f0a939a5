"""The posterior of a law's parameters: draws by NUTS, as ArviZ data.

Nothing else of the project imports blackjax or arviz, which `softjax-contact[bayes]` installs.
"""
