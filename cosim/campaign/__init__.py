"""Many flights: draws, one pool of workers, a folder of rows; `cosim.campaign.engine` flies them.

Nothing is imported here: a worker imports this package, and needs no pandas.
"""
