"""Every contact law fitted to one data set, and which of them it prefers.

candidates    which laws, with which free parameters, from which starts
zhou          the candidates of Zhou's law, by what the data can tell of σ and ψ
curves        ε(v) of a candidate as one compiled function, and what is observed
refits        Levenberg–Marquardt from many starts, or without each point in turn
linear        the linear spring–dashpot in closed form, for either end of its contact
scores        rms, leave-one-out rms, AICc, standard errors
entries       one candidate against one data set: an `Entry`
ranking       all candidates against one data set: a `Ranking`
doubts        what makes an entry doubtful
telling       tables and JSON
pictures, figure_2, linear_picture    pictures
"""
