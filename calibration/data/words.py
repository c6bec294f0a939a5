"""Words of people's tables, in the languages that laboratories write: what a column or a row is about.

Each table has words as `calibration.data.columns.plain` makes them, without what numbers a thing ("no", "id", "#").
"""

import re

from calibration.data.columns import plain


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# what numbers or names the thing of a heading: "Trial no.", "Ball type"
NAMING = _words(
    "no nr num number id name label index nummer numero número numéro n° nº № type kind art typ "
    "tipo"
)
# rows are counted
COUNTED = _words(
    "# n i k row line index count bounce bounces impact rebound point measurement id no nr num "
    "number nummer numero número numéro n° nº № lfd aufprall stoß stoss rebond rimbalzo rebote "
    "stuit"
)
# of which the heights between them are measured
BOUNCED = _words("bounce bounces rebound impact aufprall stoß stoss rebond rimbalzo rebote stuit")
# the same once more: of bounces another launch, of single impacts nothing
REPETITIONS = _words(
    "trial trials run runs drop drops throw throws test tests shot shots series serie set repeat "
    "repeats repetition replicate rep attempt try experiment launch part versuch versuche wurf "
    "würfe durchgang durchlauf lauf messreihe reihe messung fallversuch essai essais lancer chute "
    "mesure série répétition expérience lancio lanci prova prove misura ripetizione ensayo "
    "lanzamiento medida medición medicion intento tirada repetición repeticion experimento caída "
    "poging worp proef meting kast försök forsøk mätning ensaio tentativa lançamento"
)
# materials: a law is of one of them
MATERIALS = _words(
    "material materials surface floor ground substrate target plate wall coating alloy table "
    "werkstoff werkstoffe oberfläche oberflaeche unterlage untergrund boden belag platte matériau "
    "materiau matière matiere sol revêtement plaque materiale superficie pavimento piastra lega "
    "suelo piso placa aleación aleacion materiaal oppervlak ondergrond vloer yta underlag"
)
# specimens, of one material or of several
SPECIMENS = _words(
    "ball balls sample samples object sphere bead marble particle brand color colour kugel kugeln "
    "bälle proben probe prüfkörper pruefkoerper murmel farbe marke balle balles bille billes "
    "échantillon echantillon couleur palla palle pallina palline campione sfera biglia colore "
    "pelota bola bolas muestra esfera canica bal ballen kogel monster boll kula prov"
)
# impacts that are not normal
ANGLES = _words(
    "angle angles theta θ incidence deg degree degrees inclination tilt oblique obliquity winkel "
    "einfallswinkel auftreffwinkel neigung neigungswinkel aufprallwinkel inclinaison angolo "
    "incidenza inclinazione ángulo angulo incidencia inclinación hoek vinkel ângulo"
)
ANGLE_UNITS = {"deg", "°", "degree", "degrees", "rad", "radian", "radians", "grad", "º", "mrad"}
# nothing that matters
REMARKS = _words(
    "note notes comment comments remark remarks observation observations operator observer "
    "student name date day time timestamp stamp clock video movie file filename path quality "
    "status ok valid used weather place room camera bemerkung bemerkungen kommentar anmerkung "
    "notiz datum uhrzeit datei prüfer bediener remarque remarques commentaire opérateur fichier "
    "nota osservazioni operatore observaciones comentario fecha archivo operador data opmerking "
    "anmärkning kommentti"
)
# a number about other rows or columns
STATISTICS = _words(
    "mean means average averages avg ave aver sum total totals sd std stdev stddev std_dev "
    "std_deviation median med min max minimum maximum range sem se cv rsd rms variance var "
    "standard_deviation standard_error st_dev st_deviation mean_value average_value grand_mean "
    "overall overall_mean result mittelwert mittel mittelwerte mw durchschnitt schnitt summe "
    "gesamt standardabweichung stabw stdabw streuung standardfehler varianz spannweite moyenne "
    "moyennes moy somme écart_type ecart_type écart-type médiane mediane erreur_type media medie "
    "somma totale deviazione_standard scarto scarto_tipo mediana dev_st varianza minimo massimo "
    "promedio suma desviación_estándar desviacion_estandar desviación_típica desviación "
    "desviacion desvest mínimo máximo maximo rango gemiddelde gem som standaarddeviatie "
    "standaardafwijking mediaan medel medelvärde medelverdi snitt summa média soma desvio_padrão "
    "desvio x̄ ø ∅ μ µ σ среднее сумма 平均 平均值 标准差 合計"
)
BEHIND = re.compile(r"(?:[\s:=.]|_|\(.*\)|\[.*\]|[±+/-]|of|n|\d|all|und|and|et|e|y|values?|value)*")


def tokens(heading: str) -> list[str]:
    """The words of a heading without its unit and without what only numbers a thing."""
    text = re.sub(r"[\[(].*", "", heading)
    words = [word for word in re.split(r"[_/,:;]+", plain(text.replace("#", " # "))) if word]
    return [word for word in words if word not in NAMING and word != "#"] or words


def unit_in(heading: str) -> str | None:
    """Text in the last brackets of a heading."""
    match = re.search(r"[\[(]([^\[\]()]*)[\])]\s*$", heading)
    return match[1].strip() if match else None


def is_angle(heading: str) -> bool:
    unit = (unit_in(heading) or "").casefold()
    return unit in ANGLE_UNITS or bool({*tokens(heading)} & ANGLES)


def is_statistic(text: str) -> bool:
    """Whether a cell says that its row is a mean, a sum or the like of others."""
    words = plain(text).strip(":=")
    if words in STATISTICS:
        return True
    head = re.split(r"[\s:=(\[±+/_]", text.strip().casefold(), maxsplit=1)[0].strip(".")
    rest = text.strip()[len(head) :]
    return head in STATISTICS and bool(BEHIND.fullmatch(rest.casefold().lstrip(".")))


def is_statistic_heading(heading: str) -> bool:
    """Whether a column is a mean, a deviation or the like of other columns."""
    words = tokens(heading)
    return bool(words) and (
        words[0] in STATISTICS or words[-1] in STATISTICS or "_".join(words) in STATISTICS
    )
