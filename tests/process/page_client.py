"""Somebody at the page who starts the drive, keeps control, and is killed: page_client.py PORT USER PASSWORD DRIVE."""

import http.client
import json
import sys
import time

port, user, password, drive = sys.argv[1:]
head = {"Content-Type": "application/json", "Origin": f"http://127.0.0.1:{port}"}


def ask(method, path, body=None):
    page = http.client.HTTPConnection("127.0.0.1", int(port), timeout=20)
    page.request(method, path, body, head)
    answer = page.getresponse()
    return answer, answer.read()


def post(path, body):
    return ask("POST", path, json.dumps(body))


def order(path, body):
    head["Vfd-Moment"] = json.loads(ask("GET", "/api/v1/session")[1])["moment"]
    return post(path, body)


answer, body = post("/api/v1/session", {"user": user, "password": password})
head["Cookie"] = answer.getheader("Set-Cookie").split(";")[0]
head["X-CSRF-Token"] = json.loads(body)["token"]
answer, body = order(f"/api/v1/drives/{drive}/command", {"run": "forward", "frequency_hz": 30})
print(body.decode(), flush=True)
while True:
    time.sleep(0.5)
    answer, body = order(f"/api/v1/drives/{drive}/lease", {})
    print(json.dumps({"lease": answer.status}), flush=True)
