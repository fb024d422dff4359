"""Small scenes that the tests vary."""


def scene_of(**parts):
    return {"strandline": 1, "name": "test", "duration": 1.0} | parts


def cloth(name="cloth", **parts):
    return {"name": name, "material": "cotton-thick", "warps": 4, "wefts": 5, "spacing": 0.0056} | parts


def rod(name="rod", **parts):
    return {"name": name, "material": "cotton-thick", "points": [[0, 0, 0], [1, 0, 0]]} | parts


def hair(name="hair", **parts):
    return {"name": name, "material": "hair"} | parts


def groom(**parts):
    return hair(groom={"count": 20, "length": 0.1} | ({} if "on" in parts else {"rectangle": [0.1, 0.05]}) | parts)


def liquid(*initial, **parts):
    return scene_of(liquid={"material": "water", "spacing": 0.01, "initial": list(initial)} | parts)


def block(low=(0, 0, 0), high=(0.1, 0.05, 0.04), **parts):
    return {"shape": "box", "low": list(low), "high": list(high)} | parts
