"""Guide: plan paths to the goal on the cost map.

`route` finds the cheapest route on the whole map. With a predictor of frontiers, `frontiers` finds
the borders of the observed space, and `subgoals` adds the expected cost of trying each of them to
the cost map. `smoothing` turns the route into a path that the car can drive fast, by the elastic
band of `elastic_band`. Where that fails, `hybrid_astar` searches for a path, and after it
`ompl_search`. `guide` calls them, chooses between the new and the present path, and tracks the car
on it.
"""
